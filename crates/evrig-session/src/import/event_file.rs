//! A table of events becomes a session.

use super::builder::SessionBuilder;
use super::event_table::{EventSetting, EventTableOptions};
use super::frames::write_events;
use super::imported_events;
use crate::manifest::file_name;
use crate::{Journal, Manifest, Origin, SessionError, SessionStatus, StreamName};
use evrig_core::geometry::Size;
use serde_json::json;
use std::path::Path;

/// What to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportEvents<'a> {
    /// The file.
    pub file: &'a Path,
    /// The sensor's size; by default what the file states, or the smallest grid of its events.
    pub size: Option<Size>,
    /// What the user states about the events.
    pub options: EventTableOptions,
}

/// Makes a session of the events of a file, as stream `real`.
///
/// # Errors
/// When the file is not what it should be, `root` is taken, or writing fails.
pub fn import_events(request: &ImportEvents<'_>, root: &Path) -> Result<Manifest, SessionError> {
    let name = StreamName::new("real")?;
    let setting = EventSetting { size: request.size, frames_us: None };
    let found = imported_events::read(request.file, name.as_str(), &request.options, setting)?;
    let builder = SessionBuilder::take(root)?;
    let (entry, path) = write_events(&builder, &name, request.file, &found)?;
    let files = [builder.file_entry(&path)?];
    let ending = request.file.extension().map(|e| e.to_string_lossy().to_lowercase());
    let format = ending.unwrap_or_default();
    let origin = Origin::Converted { file: file_name(request.file), format };
    let status = SessionStatus::Complete;
    let manifest = Manifest::new(root, origin, status, vec![entry], files, found.losses);
    let manifest = Manifest { decisions: found.decisions, ..manifest };
    let mut journal = Journal::open(&builder.layout.journal())?;
    let note = json!({ "decisions": manifest.decisions, "losses": manifest.losses });
    journal.note("import", &note)?;
    builder.seal(&manifest)?;
    Ok(manifest)
}
