//! Sessions: one recording is one directory.
//!
//! ```text
//! <session>/
//!   session.json     manifest: what was recorded with what, streams, checksums, losses
//!   davis.aedat4     events, APS frames, IMU as the camera gave them
//!   rig.mcap         Pi frames and metadata, arm poses, commanded path, clock readings, log
//!   frames/          imported frames (npy) with their timestamps
//!   streams/<name>/  imported events
//!   journal.jsonl    what happened, when
//!   derived/<stage>[-<stream>]/   results, with inputs and parameters in stage.json
//! ```
//! Recorded files are never rewritten: defects (a truncated tail, events off
//! the sensor, disorder) are counted when they are read and stated in the manifest.

mod checksum;
mod epochs;
mod error;
mod file_counts;
mod frames;
pub mod import;
mod journal;
mod layout;
mod manifest;
mod read;
mod recording;
mod recording_check;
mod repair;
pub mod rig;
mod rig_log;
mod session;
mod stage;
pub mod trajectory;
mod verify;

pub use checksum::{Sha256Hex, sha256_of_bytes, sha256_of_file};
pub use error::SessionError;
pub use file_counts::{FileCounts, StreamCounts, count_file};
pub use frames::{DavisFrames, FrameProperties, PiCameraFrames, PiStamps, RecordedFrame};
pub use journal::Journal;
pub use layout::{SessionLayout, StreamName};
pub use manifest::write_whole;
pub use manifest::{
    Damage, DataLoss, DeviceEntry, FileEntry, Manifest, Origin, Recording, SCHEMA, SessionStatus,
    StreamEntry, StreamKind,
};
pub use read::{AscendingFrames, EventTally, LuminanceFrames};
pub use recording::seal_recording;
pub use recording_check::{EventChecksum, ImageChecksum, RecordingCheck};
pub use repair::{Repair, repair};
pub use rig_log::{
    Arrival, ClockExchange, HostTime, PacketArrival, RigLogContents, RigLogError, RigLogWriter,
    Severity, TimedPose, Topic,
};
pub use rig_log::{image_message, image_schema};
pub use session::Session;
pub use stage::{StageRecord, read_stage, write_stage};
pub use verify::{Verification, verify};
