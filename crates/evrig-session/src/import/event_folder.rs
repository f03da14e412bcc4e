//! A folder in the layout of the Event-Camera Dataset (Mueggler et al. 2017) becomes a session.
//!
//! `events.txt` holds t, x, y, p, `images.txt` the time and the path of each image of `images/`.
//! IMU, ground truth and calibration are not read.

use super::event_file::{ImportEvents, import_events};
use super::event_table::EventTableOptions;
use super::frame_times::FrameTimes;
use super::frames::{ImportFrames, import_frames};
use super::raw_frames::RawFrameOptions;
use crate::{Manifest, SessionError, StreamName};
use evrig_core::geometry::Size;
use std::path::Path;

/// Makes a session of a folder.
///
/// # Errors
/// When a file is not what it should be, `root` is taken, or writing fails.
pub fn import_event_folder(
    folder: &Path,
    size: Option<Size>,
    options: &EventTableOptions,
    root: &Path,
) -> Result<Manifest, SessionError> {
    let events = folder.join("events.txt");
    let (images, times) = (folder.join("images"), folder.join("images.txt"));
    if !images.is_dir() || !times.exists() {
        return import_events(
            &ImportEvents { file: &events, size, options: options.clone() },
            root,
        );
    }
    let request = ImportFrames {
        frames: &images,
        times: FrameTimes::File(times),
        frame_time_unit: None,
        events: Some(&events),
        events_name: StreamName::new("real")?,
        options: options.clone(),
        raw: RawFrameOptions::default(),
    };
    import_frames(&request, root)
}
