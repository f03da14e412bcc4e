//! The events of a recording, and when its camera took frames, without making a session.

use super::detect::{RecordingKind, detect};
use super::event_table::{EventSetting, EventTableOptions};
use super::typed_events::ImportedEvents;
use super::{frame_times, imported_events};
use crate::{DataLoss, SessionError};
use evrig_core::event::Events;
use evrig_core::frame::FrameTiming;
use evrig_core::geometry::Size;
use evrig_core::time::{Davis, Stamp};
use std::path::Path;

/// Events of a recording, with the timing of the frames that the same camera took.
#[derive(Debug)]
pub struct CameraRecording {
    /// In ascending time, on the sensor.
    pub events: Events,
    /// The sensor.
    pub size: Size,
    /// Timing of the frames on the events' clock; empty where the recording has none.
    pub frames: Vec<FrameTiming<Davis>>,
    /// What could not be taken.
    pub losses: Vec<DataLoss>,
    /// What had to be decided about the file.
    pub decisions: Vec<String>,
}

/// Reads the events of a recording of any kind that has events.
///
/// # Errors
/// When the path holds no events, or they are not what they should be.
pub fn read_recording(
    path: &Path,
    size: Option<Size>,
    options: &EventTableOptions,
) -> Result<CameraRecording, SessionError> {
    let setting = EventSetting { size, frames_us: None };
    match detect(path)? {
        RecordingKind::Aedat4 => {
            let (found, frames) = imported_events::read_aedat4(path, "events", options, setting)?;
            Ok(CameraRecording::new(found, frames))
        }
        RecordingKind::Events | RecordingKind::Recording => {
            let found = imported_events::read(path, "events", options, setting)?;
            Ok(CameraRecording::new(found, Vec::new()))
        }
        RecordingKind::EventFolder => {
            let file = path.join("events.txt");
            let mut found = imported_events::read(&file, "events", options, setting)?;
            let times = path.join("images.txt");
            let mut frames = Vec::new();
            if times.exists() {
                let decided = frame_times::times_of_file(&times)?;
                let stamps = decided.t_us.into_iter().map(Stamp::from_micros);
                frames = stamps.map(FrameTiming::from_stamp).collect();
                found.decisions.extend(decided.decisions);
            }
            Ok(CameraRecording::new(found, frames))
        }
        RecordingKind::Frames => Err(SessionError::import(
            path,
            "holds frames without events; expected a recording or a table of events",
        )),
        RecordingKind::Raw2Event => Err(SessionError::import(
            path,
            "is a folder of the Raw2Event recorder; give one of its dv_output_*.aedat4 files",
        )),
    }
}

impl CameraRecording {
    fn new(found: ImportedEvents, frames: Vec<FrameTiming<Davis>>) -> Self {
        let ImportedEvents { events, size, losses, decisions } = found;
        Self { events, size, frames, losses, decisions }
    }
}
