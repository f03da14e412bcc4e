//! File formats, one module each, read and written in bounded memory.

pub mod aedat2;
pub mod aedat3;
pub mod aedat4;
mod camera_events;
mod column;
mod destination;
pub mod hdf5;
pub mod npy;
pub mod parquet;
pub mod prophesee;
pub mod raw2event;
mod recording;
mod ros;
pub mod rosbag;
pub mod rosbag2;
mod table;
pub mod text;

pub use camera_events::{CameraEvents, CameraFileError};
pub use destination::Destination;
pub use recording::{RecordingNotes, RecordingSink, SourceStream};
pub use table::StoredTable;

/// Bytes of a file that are read and decoded at once, a multiple of every word. The events of so
/// many bytes stay in the cache, and the allocator gives their memory again without a page fault.
pub(crate) const BLOCK_BYTES: usize = 1 << 16;
