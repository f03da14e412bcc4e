//! A plain DAVIS recording becomes a session.

use super::builder::{SessionBuilder, file_name, name_and_now};
use crate::file_counts::{FileCounts, count_file};
use crate::{
    Damage, DataLoss, FileEntry, Journal, Manifest, Origin, SCHEMA, SessionError, SessionStatus,
    StreamEntry,
};
use evrig_format::aedat4::Reader;
use serde_json::json;
use std::path::Path;

/// Copies an AEDAT4 file into a new session and counts what is in it.
///
/// The bytes are kept as they are, a damaged tail included. `progress` is told the number of
/// bytes done out of twice the file's length (copy and count).
///
/// # Errors
/// When the file is no AEDAT4 file or nothing in it can be read, `root` is taken, or the disk refuses.
pub fn import_aedat4(
    source: &Path,
    root: &Path,
    progress: &mut dyn FnMut(u64),
) -> Result<Manifest, SessionError> {
    // Refuse what is no AEDAT4 file before anything is made.
    drop(Reader::open(source)?);
    let site = SessionBuilder::take(root)?;
    let path = site.layout.davis();
    let n_bytes = std::fs::copy(source, &path).map_err(SessionError::io(source))?;
    progress(n_bytes);
    let found = count_file(&path, &mut |offset| progress(n_bytes + offset))?;
    let n_read: u64 = found.streams.iter().map(|stream| stream.count).sum();
    if let (Some(damage), 0) = (&found.damage, n_read) {
        return Err(SessionError::import(source, format!("nothing can be read: {damage}")));
    }
    let manifest = manifest(&site, source, &path, &found)?;
    let mut journal = Journal::open(&site.layout.journal())?;
    journal
        .note("import aedat4", &json!({"file": file_name(source), "losses": manifest.losses}))?;
    site.seal(&manifest)?;
    Ok(manifest)
}

fn manifest(
    site: &SessionBuilder,
    source: &Path,
    path: &Path,
    found: &FileCounts,
) -> Result<Manifest, SessionError> {
    let DescribedFile { streams, file, losses } = describe(site, path, found)?;
    let (name, created) = name_and_now(site.layout.root());
    Ok(Manifest {
        schema: SCHEMA.into(),
        name,
        evrig_version: env!("CARGO_PKG_VERSION").into(),
        created,
        origin: Origin::Aedat4 { file: file_name(source) },
        status: if found.damage.is_some() {
            SessionStatus::Recovered
        } else {
            SessionStatus::Complete
        },
        streams,
        files: [file].into(),
        losses,
        decisions: Vec::new(),
        recording: None,
    })
}

/// An AEDAT4 file as a manifest describes it.
pub(super) struct DescribedFile {
    pub(super) streams: Vec<StreamEntry>,
    /// Its path inside the session, with length and checksum.
    pub(super) file: (String, FileEntry),
    pub(super) losses: Vec<DataLoss>,
}

/// Describes a counted AEDAT4 file inside the session.
pub(super) fn describe(
    site: &SessionBuilder,
    path: &Path,
    found: &FileCounts,
) -> Result<DescribedFile, SessionError> {
    let (file, mut entry) = site.file_entry(path)?;
    let mut losses = found.losses.clone();
    if let Some(what) = &found.damage {
        entry.damage = Some(Damage { what: what.clone() });
        losses.push(DataLoss { stream: file.clone(), what: what.clone(), count: 0 });
    }
    let streams = found.entries(&file);
    Ok(DescribedFile { streams, file: (file, entry), losses })
}
