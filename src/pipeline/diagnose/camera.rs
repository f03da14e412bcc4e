//! The diagnosed camera, for generation.

use super::{Baseline, result};
use crate::pipeline::error::missing;
use crate::pipeline::{PipelineError, read_json};
use evrig_analysis::diagnose::{DiagnosisVerdict, FittedCamera};
use evrig_session::Session;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Its file name.
pub(super) const CAMERA: &str = "camera.json";

/// Its schema.
pub(super) const CAMERA_SCHEMA: &str = "evrig.camera/2";

/// The previous schema, whose keys are read as aliases.
const OLD_CAMERA_SCHEMA: &str = "evrig.camera/1";

/// The camera of a diagnosis, and the source of its signal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiagnosedCamera {
    /// `evrig.camera/2`.
    pub schema: String,
    /// The verdict of the diagnosis.
    pub verdict: DiagnosisVerdict,
    /// Source of the signal of its recording.
    pub baseline: Baseline,
    /// The camera.
    pub fitted: FittedCamera,
}

impl DiagnosedCamera {
    /// Why its events differ from those of the real camera, a sentence each.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let verdict = match self.verdict {
            DiagnosisVerdict::NoMismatch
            | DiagnosisVerdict::MinorMismatch
            | DiagnosisVerdict::Explained => None,
            DiagnosisVerdict::PartlyExplained => {
                Some("the named effects explain its recording only in part")
            }
            DiagnosisVerdict::Unexplained => Some("no effect explains its recording"),
        };
        let left_out = self.fitted.left_out.iter().map(|what| format!("left out: {what}"));
        verdict.map(str::to_owned).into_iter().chain(left_out).collect()
    }

    /// Reads a file.
    ///
    /// # Errors
    ///
    /// When the file does not exist, cannot be read or is no camera.
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
        if ![CAMERA_SCHEMA, OLD_CAMERA_SCHEMA].contains(&camera.schema.as_str()) {
            return Err(wrong(format!(
                "its schema is `{}`; expected {CAMERA_SCHEMA}",
                camera.schema
            )));
        }
        camera.fitted.camera.check().map_err(|error| wrong(error.to_string()))?;
        Ok(camera)
    }
}

/// The camera of a session's diagnosis.
///
/// # Errors
///
/// When there is none, or the file cannot be read.
pub fn read_camera(session: &Session) -> Result<DiagnosedCamera, PipelineError> {
    let path = result(session, CAMERA);
    if !path.exists() {
        let root = session.root().display();
        // A diagnosis of a version without this file is fresh all the same.
        let again = if result(session, "diagnosis.json").exists() { " --force" } else { "" };
        let what = format!("it has no diagnosed camera; run `evrig diagnose {root}{again}` first");
        return Err(missing(session, what));
    }
    DiagnosedCamera::read(&path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_no_camera_is_refused_with_advice() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("camera.json");
        let message = || DiagnosedCamera::read(&path).unwrap_err().to_string();
        assert!(message().contains("evrig diagnose SESSION"), "{}", message());
        std::fs::write(&path, "{\"schema\": \"evrig.camera/1\"").unwrap();
        assert!(message().contains("camera.json") && message().contains("EOF"), "{}", message());
        std::fs::write(&path, "{\"schema\": \"evrig.calibration/1\", \"k\": []}").unwrap();
        assert!(message().contains("unknown field `k`"), "{}", message());
    }
}
