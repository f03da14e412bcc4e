//! `rig.mcap`: the rig's log and the Pi's frames, in Foxglove's published schemas.
//!
//! | topic | schema | what |
//! | --- | --- | --- |
//! | `/pi/raw` | foxglove.RawImage | raw Bayer frames, `mono16`, right-justified |
//! | `/pi/rgb` | foxglove.RawImage | the same requests' RGB frames, `rgb8` |
//! | `/pi/metadata` | evrig.FrameMetadata | metadata of each frame |
//! | `/pi/clock` | evrig.ClockExchange | the Pi's clocks, read between two readings of ours |
//! | `/davis/arrivals` | evrig.Arrival | when each packet of the event camera reached the host |
//! | `/arm/pose` | foxglove.PoseInFrame | tool pose reported by the arm |
//! | `/arm/commanded` | foxglove.PoseInFrame | tool pose commanded by the trajectory |
//! | `/log` | foxglove.Log | log of the recorder |
//!
//! A message's log time is Unix time on the host; the devices' timestamps are in the
//! messages. Chunks are closed every quarter of a second, so a truncated file lacks little.

mod contents;
mod counts;
mod error;
mod image;
mod image_reader;
mod reader;
mod records;
mod schema;
mod source;
mod writer;

pub(super) use contents::read_contents;
pub use contents::{RigLogContents, TimedPose};
pub(super) use counts::{RigLogCounts, arrivals, count_log, each_message_of, stream_names};
pub use error::RigLogError;
pub(super) use image::decode_image;
pub use image::{encode_in as image_message, schema as image_schema};
pub(super) use image_reader::{ImageReader, StoredImage};
pub use records::{Arrival, ClockExchange, HostTime, PacketArrival, Severity};
pub use writer::{RigLogWriter, Topic};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_reported_with_the_message_of_the_system() {
        let full = std::io::Error::from_raw_os_error(28);
        let expected = full.to_string();
        let source = Box::new(mcap::McapError::Io(full));
        let error = RigLogError::Write { path: "rig.mcap".into(), message: 3, source };
        assert!(error.to_string().contains(&expected), "{error}");
    }
}
