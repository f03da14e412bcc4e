//! Import of recordings made by other programs.

mod aedat4;
mod aedat4_epochs;
mod builder;
mod camera_recording;
mod detect;
mod event_file;
mod event_folder;
mod event_table;
mod foreign_recording;
mod frame_times;
mod frames;
mod images;
mod imported_events;
mod raw2event;
mod raw_frames;
mod simulated_events;
mod typed_events;

pub use crate::epochs::EpochChoice;
pub use aedat4::import_aedat4;
pub use camera_recording::{CameraRecording, read_recording};
pub use detect::{RecordingKind, detect};
pub use event_file::{ImportEvents, import_events};
pub use event_folder::import_event_folder;
pub use event_table::{ColumnOrder, EventTableOptions, PolarityRule, TimeUnit};
pub use foreign_recording::{ImportRecording, import_recording};
pub use frame_times::FrameTimes;
pub use frames::{ImportFrames, import_frames};
pub use raw_frames::{RawFrameOptions, SamplePacking};
pub use raw2event::{ImportRaw2Event, import_raw2event};
pub use simulated_events::read_simulated_events;
