//! A recording in the layout of the published Raw2Event recorder becomes a session.

mod files;
mod pi_frames;
mod request;

pub use request::ImportRaw2Event;

use super::aedat4::{DescribedFile, describe};
use super::builder::{SessionBuilder, file_name, name_and_now};
use crate::file_counts::count_file;
use crate::{Journal, Manifest, Origin, SCHEMA, SessionError, SessionStatus};
use evrig_format::aedat4::Reader;
use files::RecordingFiles;
use pi_frames::PiFrames;
use serde_json::json;
use std::path::Path;

/// Makes a session of a DAVIS recording and the Pi's frames beside it.
///
/// # Errors
/// When `id` matches no recording or several, a file is not what it should be, `root` is
/// taken, or the disk refuses.
pub fn import_raw2event(
    request: &ImportRaw2Event<'_>,
    root: &Path,
    progress: &mut dyn FnMut(u64),
) -> Result<Manifest, SessionError> {
    let files = RecordingFiles::find(request.directory, request.id)?;
    drop(Reader::open(&files.davis)?);
    let site = SessionBuilder::take(root)?;
    let davis = site.layout.davis();
    let mut n_done = std::fs::copy(&files.davis, &davis).map_err(SessionError::io(&davis))?;
    progress(n_done);
    let found = count_file(&davis, &mut |_| {})?;
    let DescribedFile { mut streams, file: davis_file, mut losses } =
        describe(&site, &davis, &found)?;
    let pi = PiFrames::read(request, &files, &site, &mut |n| {
        n_done += n;
        progress(n_done);
    })?;
    streams.extend(pi.streams);
    losses.extend(pi.losses);
    let mut decisions = files.decisions;
    decisions.extend(pi.decisions);
    let is_cut = davis_file.1.damage.is_some();
    let mut recorded = vec![davis_file];
    for path in &pi.files {
        recorded.push(site.file_entry(path)?);
    }
    let (name, created) = name_and_now(root);
    let manifest = Manifest {
        schema: SCHEMA.into(),
        name,
        evrig_version: env!("CARGO_PKG_VERSION").into(),
        created,
        origin: Origin::Raw2Event { id: request.id.into(), davis: file_name(&files.davis) },
        status: if is_cut { SessionStatus::Recovered } else { SessionStatus::Complete },
        streams,
        files: recorded.into_iter().collect(),
        losses,
        decisions,
        recording: None,
    };
    let mut journal = Journal::open(&site.layout.journal())?;
    journal.note(
        "import raw2event",
        &json!({ "decisions": manifest.decisions, "losses": manifest.losses }),
    )?;
    site.seal(&manifest)?;
    Ok(manifest)
}
