//! The camera that a diagnosis found, kept beside it for whoever generates with it.

use super::{Baseline, result};
use crate::pipeline::error::missing;
use crate::pipeline::{PipelineError, read_json};
use evrig_analysis::diagnose::{FittedCamera, Verdict};
use evrig_session::Session;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Its file beside the diagnosis.
pub(super) const CAMERA: &str = "camera.json";

/// What the file says of itself.
pub(super) const CAMERA_SCHEMA: &str = "evrig.camera/1";

/// The camera of a diagnosis, and the light that it was found in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiagnosedCamera {
    /// `evrig.camera/1`.
    pub schema: String,
    /// What the diagnosis said.
    pub verdict: Verdict,
    /// The light of its recording.
    pub baseline: Baseline,
    /// The camera.
    pub fitted: FittedCamera,
}

impl DiagnosedCamera {
    /// What keeps its events from being those of the real camera, a sentence each.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let verdict = match self.verdict {
            Verdict::NoMismatch | Verdict::Explained => None,
            Verdict::PartlyExplained => Some("its recording shows more than the named effects"),
            Verdict::Unexplained => Some("its recording is not explained: events come otherwise"),
        };
        let left_out = self.fitted.left_out.iter().map(|what| format!("left out: {what}"));
        verdict.map(str::to_owned).into_iter().chain(left_out).collect()
    }

    /// Reads one from a file.
    ///
    /// # Errors
    /// When the file is not there, cannot be read or is none.
    pub fn read(path: &Path) -> Result<Self, PipelineError> {
        let none = || PipelineError::Io {
            path: path.to_owned(),
            source: std::io::Error::new(
                std::io::ErrorKind::NotFound,
                "no such file; `evrig diagnose SESSION` makes SESSION/derived/diagnose/camera.json",
            ),
        };
        let camera: Self = read_json(path.to_owned())?.ok_or_else(none)?;
        let wrong = |what: String| PipelineError::Io {
            path: path.to_owned(),
            source: std::io::Error::new(std::io::ErrorKind::InvalidData, what),
        };
        if camera.schema != CAMERA_SCHEMA {
            return Err(wrong(format!(
                "its schema is `{}`; expected {CAMERA_SCHEMA}",
                camera.schema
            )));
        }
        camera.fitted.camera.check().map_err(|error| wrong(error.to_string()))?;
        Ok(camera)
    }
}

/// The camera of the diagnosis that a session holds.
///
/// # Errors
/// When there is none, or the file cannot be read.
pub fn read_camera(session: &Session) -> Result<DiagnosedCamera, PipelineError> {
    let path = result(session, CAMERA);
    if !path.exists() {
        let root = session.root().display();
        // One of a version that kept none is fresh all the same.
        let again = if result(session, "diagnosis.json").exists() { " --force" } else { "" };
        let what =
            format!("it holds no diagnosed camera; run `evrig diagnose {root}{again}` first");
        return Err(missing(session, what));
    }
    DiagnosedCamera::read(&path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_no_camera_is_refused_with_its_path_and_what_makes_one() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("camera.json");
        let said = || DiagnosedCamera::read(&path).unwrap_err().to_string();
        assert!(said().contains("evrig diagnose SESSION"), "{}", said());
        std::fs::write(&path, "{\"schema\": \"evrig.camera/1\"").unwrap();
        assert!(said().contains("camera.json") && said().contains("EOF"), "{}", said());
        std::fs::write(&path, "{\"schema\": \"evrig.calibration/1\", \"k\": []}").unwrap();
        assert!(said().contains("unknown field `k`"), "{}", said());
    }
}
