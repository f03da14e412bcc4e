//! A recording in the layout of the published Raw2Event recorder becomes a session.

mod files;
mod pi_frames;
mod request;

pub use request::ImportRaw2Event;

use super::aedat4::{DescribedFile, describe};
use super::builder::SessionBuilder;
use crate::file_counts::count_file;
use crate::manifest::file_name;
use crate::{Journal, Manifest, Origin, SessionError, SessionStatus};
use evrig_format::aedat4::Reader;
use files::RecordingFiles;
use pi_frames::ImportedPiFrames;
use serde_json::json;
use std::path::Path;

/// Makes a session of a DAVIS recording and the Pi's frames.
///
/// # Errors
/// When `id` matches no recording or several, a file is not what it should be, `root` is
/// taken, or writing fails.
pub fn import_raw2event(
    request: &ImportRaw2Event<'_>,
    root: &Path,
    progress: &mut dyn FnMut(u64),
) -> Result<Manifest, SessionError> {
    let files = RecordingFiles::find(request.directory, request.id)?;
    drop(Reader::open(&files.davis)?);
    let builder = SessionBuilder::take(root)?;
    let davis = builder.layout.davis();
    let mut n_done = std::fs::copy(&files.davis, &davis).map_err(SessionError::io(&davis))?;
    progress(n_done);
    let found = count_file(&davis, &mut |_| {})?;
    let DescribedFile { mut streams, file: davis_file, mut losses } =
        describe(builder.file_entry(&davis)?, &found);
    let pi = ImportedPiFrames::read(request, &files, &builder, &mut |n| {
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
        recorded.push(builder.file_entry(path)?);
    }
    let status = if is_cut { SessionStatus::Recovered } else { SessionStatus::Complete };
    let origin = Origin::Raw2Event { id: request.id.into(), davis: file_name(&files.davis) };
    let manifest =
        Manifest { decisions, ..Manifest::new(root, origin, status, streams, recorded, losses) };
    let mut journal = Journal::open(&builder.layout.journal())?;
    journal.note(
        "import raw2event",
        &json!({ "decisions": manifest.decisions, "losses": manifest.losses }),
    )?;
    builder.seal(&manifest)?;
    Ok(manifest)
}
