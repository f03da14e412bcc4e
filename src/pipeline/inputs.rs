//! Checksums of a stage's inputs.

use evrig_session::{
    Session, SessionError, Sha256Hex, StreamEntry, StreamKind, StreamName, read_stage,
};
use std::collections::BTreeMap;

/// Checksums by path inside the session.
pub(super) type Inputs = BTreeMap<String, Sha256Hex>;

/// Checksums of the files behind a recorded or imported stream, as its manifest has them
/// (`evrig verify` holds the manifest against the files).
pub(super) fn of_recorded(session: &Session, entry: &StreamEntry) -> Inputs {
    let folder = entry.file.rsplit_once('/').map(|(folder, _)| format!("{folder}/"));
    let belongs = |file: &str| {
        file == entry.file
            || folder.as_ref().is_some_and(|folder| file.starts_with(folder.as_str()))
    };
    let files = session.manifest().files.iter();
    files
        .filter(|(file, _)| belongs(file))
        .map(|(file, entry)| (file.clone(), entry.sha256.clone()))
        .collect()
}

/// Checksums of the files behind an event stream, recorded, imported or generated.
pub(super) fn of_events(session: &Session, name: &str) -> Result<Inputs, SessionError> {
    let not_recorded = match session.stream(StreamKind::Events, name) {
        Ok(entry) => return Ok(of_recorded(session, entry)),
        Err(error) => error,
    };
    let made = StreamName::new(name)?;
    let directory = session.layout().derived("generate", Some(&made));
    let record = read_stage(&directory).ok_or(not_recorded)?;
    let inside = |file: String| format!("derived/generate-{made}/{file}");
    Ok(record.outputs.into_iter().map(|(file, sha256)| (inside(file), sha256)).collect())
}
