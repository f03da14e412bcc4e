//! Import of recordings made by other programs.

mod aedat4;
mod builder;
mod event_table;
mod frames;
mod images;
mod raw2event;

pub use aedat4::import_aedat4;
pub use frames::{FrameTimes, ImportFrames, import_frames};
pub use raw2event::{ImportRaw2Event, import_raw2event};
