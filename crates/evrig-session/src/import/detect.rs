//! What a file or folder holds, by its first bytes and its ending.

use super::event_table::TABLE_ENDINGS;
use super::imported_events::{CameraFormat, SQLITE_REMEDY};
use crate::SessionError;
use evrig_format::npy::ArrayReader;
use std::io::Read;
use std::path::Path;

/// What a path holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordingKind {
    /// An AEDAT4 file.
    Aedat4,
    /// An array of frames, or a folder of images.
    Frames,
    /// A folder of the Raw2Event recorder.
    Raw2Event,
    /// A folder in the layout of the Event-Camera Dataset: `events.txt`, `images.txt`, `images/`.
    EventFolder,
    /// A recording of another program: AEDAT 2 or 3.1, Prophesee, ROS.
    Recording,
    /// A table of events.
    Events,
}

/// Finds out what a path holds.
///
/// # Errors
/// When there is nothing, or nothing that is read.
pub fn detect(path: &Path) -> Result<RecordingKind, SessionError> {
    if path.is_dir() {
        return detect_folder(path);
    }
    let mut start = Vec::new();
    let file = std::fs::File::open(path).map_err(SessionError::io(path))?;
    file.take(16).read_to_end(&mut start).map_err(SessionError::io(path))?;
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match CameraFormat::of_file(path)? {
        Some(CameraFormat::Aedat4) => return Ok(RecordingKind::Aedat4),
        Some(_) => return Ok(RecordingKind::Recording),
        None => {}
    }
    if start.starts_with(b"\x93NUMPY") {
        let reader = ArrayReader::open_cut(path)?;
        let is_frames = reader.shape().len() == 3 && reader.unsigned_bytes().is_some();
        return Ok(if is_frames { RecordingKind::Frames } else { RecordingKind::Events });
    }
    if TABLE_ENDINGS.contains(&ending.as_str()) {
        return Ok(RecordingKind::Events);
    }
    if super::frames::is_raw(path) {
        return Ok(RecordingKind::Frames);
    }
    // The import of frames names what is to be done with videos and raw files.
    if ["mp4", "mkv", "avi", "mov", "webm", "m4v", "h264", "yuv", "dng"].contains(&ending.as_str())
    {
        return Ok(RecordingKind::Frames);
    }
    Err(SessionError::import(
        path,
        format!(
            "is of no kind that is read; expected AEDAT 2, 3.1 or 4, Prophesee's .raw or .dat, a \
             ROS 1 .bag, a ROS 2 .mcap, a table of events (.{}), an npy array of frames, or a folder of images; it \
             begins with \"{}\"",
            TABLE_ENDINGS.join(", ."),
            start.escape_ascii()
        ),
    ))
}

fn detect_folder(folder: &Path) -> Result<RecordingKind, SessionError> {
    if CameraFormat::of_file(folder)?.is_some() {
        return Ok(RecordingKind::Recording);
    }
    let entries = std::fs::read_dir(folder).map_err(SessionError::io(folder))?;
    let names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    if names.iter().any(|name| name.starts_with("dv_output_") && name.ends_with(".aedat4")) {
        return Ok(RecordingKind::Raw2Event);
    }
    if names.iter().any(|name| name.ends_with(".db3")) {
        return Err(SessionError::import(folder, SQLITE_REMEDY));
    }
    let has = |name: &str| names.iter().any(|known| known == name);
    Ok(if has("events.txt") { RecordingKind::EventFolder } else { RecordingKind::Frames })
}
