//! `rig.mcap`: what the rig did and what the Pi's camera saw, in Foxglove's published schemas.
//!
//! | topic | schema | what |
//! | --- | --- | --- |
//! | `/pi/raw` | foxglove.RawImage | raw Bayer frames, `mono16`, right-justified |
//! | `/pi/rgb` | foxglove.RawImage | the same requests' RGB frames, `rgb8` |
//! | `/pi/metadata` | evrig.FrameMetadata | what the camera says of each frame |
//! | `/pi/clock` | evrig.ClockExchange | the Pi's clocks, read between two readings of ours |
//! | `/davis/arrivals` | evrig.Arrival | when each packet of the event camera reached the host |
//! | `/arm/pose` | foxglove.PoseInFrame | where the arm's planner says the tool is |
//! | `/arm/commanded` | foxglove.PoseInFrame | where the trajectory says it is |
//! | `/log` | foxglove.Log | what the engine did |
//!
//! A message's log time is Unix time on the host; the stamps of the devices stand in the
//! messages. Chunks are closed every quarter of a second, so a file that was cut lacks little.

mod counts;
mod error;
mod image;
mod length_check;
mod notes;
mod pictures;
mod reader;
mod records;
mod schema;
mod source;
mod writer;

pub(super) use counts::{RigLogCounts, arrivals, count_log, each_message_of, stream_names};
pub use error::RigLogError;
pub(super) use image::decode_picture;
pub use image::{encode_in as picture_message, schema as picture_schema};
pub(super) use notes::read_notes;
pub use notes::{RigNotes, TimedPose};
pub(super) use pictures::{PictureReader, StoredPicture};
pub use records::{Arrival, ClockExchange, HostTime, PacketArrival, Severity};
pub use writer::{RigLogWriter, Topic};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_in_the_systems_own_words() {
        let full = std::io::Error::from_raw_os_error(28);
        let expected = full.to_string();
        let source = Box::new(mcap::McapError::Io(full));
        let error = RigLogError::Write { path: "rig.mcap".into(), message: 3, source };
        assert!(error.to_string().contains(&expected), "{error}");
    }
}
