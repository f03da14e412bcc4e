//! Sealing what was recorded: everything is counted from the files, then the manifest is written.

use super::manifest::file_name;
use super::rig_log::{self, stream_names};
use super::{
    Damage, DataLoss, FileCounts, FileEntry, Manifest, Origin, Recording, SessionError,
    SessionLayout, SessionStatus, StreamEntry, count_file, sha256_of_file,
};
use evrig_core::time::{Clock, Unix};
use evrig_format::aedat4::ReadError;
use std::collections::BTreeMap;
use std::path::Path;

/// Counts the files of a recording that has ended and seals its manifest.
///
/// # Errors
/// When a file cannot be read or the manifest cannot be written.
pub fn seal_recording(
    layout: &SessionLayout,
    origin: Origin,
    status: SessionStatus,
    recording: Recording,
    mut losses: Vec<DataLoss>,
) -> Result<Manifest, SessionError> {
    let mut files = BTreeMap::new();
    let mut streams = Vec::new();
    if layout.davis().exists() {
        let found = match count_file(&layout.davis(), &mut |_| {}) {
            Ok(found) => found,
            // Truncated within its header: it holds no stream.
            Err(SessionError::Aedat4Read(error @ ReadError::Malformed { .. })) => {
                let file = format!("{}: ", layout.davis().display());
                let damage = Some(error.to_string().replacen(&file, "", 1));
                FileCounts { damage, ..FileCounts::default() }
            }
            Err(error) => return Err(error),
        };
        let file = add_file(&layout.davis(), found.damage.as_deref(), &mut files, &mut losses)?;
        losses.extend(found.losses.iter().cloned());
        streams.extend(found.entries(&file));
    }
    if layout.rig_log().exists() {
        let found = rig_log::count_log(&layout.rig_log())?;
        let file = add_file(&layout.rig_log(), found.damage.as_deref(), &mut files, &mut losses)?;
        streams.extend(found.topics.iter().map(|found| {
            let (name, kind) = stream_names(found.topic);
            StreamEntry {
                name: name.to_owned(),
                kind,
                file: file.clone(),
                stream_id: None,
                size: found.size,
                count: found.count,
                first_us: found.first_us,
                last_us: found.last_us,
                // The log is ordered by the host's clock; each message holds its device's own
                // stamp.
                clock: Unix::NAME.into(),
                source: found.topic.name().to_owned(),
            }
        }));
    }
    let manifest = Manifest {
        recording: Some(Box::new(recording)),
        ..Manifest::new(layout.root(), origin, status, streams, files, losses)
    };
    manifest.seal(&layout.manifest())?;
    Ok(manifest)
}

/// Enters a file with its checksum; damage is a loss of its own.
fn add_file(
    path: &Path,
    damage: Option<&str>,
    files: &mut BTreeMap<String, FileEntry>,
    losses: &mut Vec<DataLoss>,
) -> Result<String, SessionError> {
    let (sha256, bytes) = sha256_of_file(path)?;
    let name = file_name(path);
    let damage = damage.map(|what| Damage { what: what.to_owned() });
    if let Some(Damage { what }) = &damage {
        losses.push(DataLoss { stream: name.clone(), what: what.clone(), count: 0 });
    }
    files.insert(name.clone(), FileEntry { bytes, sha256, damage });
    Ok(name)
}
