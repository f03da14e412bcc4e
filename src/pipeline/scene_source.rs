//! The reconstructed scene as a source of events: its name, white level, signal and files.

use super::error::missing;
use super::scene::read_facts;
use super::{PipelineError, inputs, read_scene};
use evrig_reconstruct::scene::SceneDrive;
use evrig_session::{Session, StreamKind, read_stage};

/// Name of the signal that the scene gives.
pub(super) const SCENE: &str = "scene";

/// Whether a name means the scene, which no frame stream may then have.
pub(super) fn is_scene(session: &Session, light: &str) -> bool {
    light == SCENE && session.stream(StreamKind::Frames, SCENE).is_err()
}

/// White level above black of the frames behind the scene, DN; none where `light` is not the scene
/// or the session holds none.
///
/// # Errors
/// When the scene's facts cannot be read.
pub fn white_of(session: &Session, light: &str) -> Result<Option<f64>, PipelineError> {
    let directory = session.layout().derived("scene", None);
    if !is_scene(session, light) || read_stage(&directory).is_none() {
        return Ok(None);
    }
    Ok(Some(read_facts(&directory)?.white_dn))
}

pub(super) fn drive_of(session: &Session) -> Result<SceneDrive, PipelineError> {
    let scene = read_scene(session)?;
    let none = || missing(session, "it holds no scene; run `evrig scene` first".into());
    Ok(scene.ok_or_else(none)?.drive())
}

/// Checksums of the scene's files.
pub(super) fn inputs_of(session: &Session) -> inputs::Inputs {
    let record = read_stage(&session.layout().derived("scene", None));
    let files = record.into_iter().flat_map(|record| record.outputs);
    files.map(|(file, sha256)| (format!("derived/scene/{file}"), sha256)).collect()
}
