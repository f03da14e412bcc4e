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

mod census;
mod fence;
mod image;
mod notes;
mod pictures;
mod reader;
mod records;
mod schema;
mod source;
mod writer;

pub(super) use census::{RigLogCensus, arrivals, census, each_message_of, stream_names};
pub(super) use image::decode_picture;
pub use image::{encode_in as picture_message, schema as picture_schema};
pub(super) use notes::read_notes;
pub use notes::{RigNotes, TimedPose};
pub(super) use pictures::{PictureReader, StoredPicture};
pub use records::{Arrival, ClockExchange, HostTime, PacketArrival, Severity};
pub use writer::{RigLogWriter, Topic};

use std::path::PathBuf;

/// What the system says where it is the system that says something.
fn reason(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(system) => system.to_string(),
        other => other.to_string(),
    }
}

/// Why the rig's log cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RigLogError {
    /// The file cannot be made or opened.
    #[error("{}: {source}; check the folder and its permissions", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Writing failed.
    #[error("{}: writing message {message} failed: {}; what was written before can be read", path.display(), reason(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// Messages before it.
        message: u64,
        /// The reason.
        source: Box<mcap::McapError>,
    },
    /// A record cannot be put into its encoding.
    #[error("{}: a message for {topic} cannot be encoded: {because}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Where it was to go.
        topic: &'static str,
        /// Why not.
        because: String,
    },
    /// A message is not what its topic says.
    #[error("{}: message {message} of those read, on {topic}: {because}; `evrig verify` says whether the file is as it was sealed", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where it stands.
        topic: &'static str,
        /// Its number among the messages read, from 1.
        message: u64,
        /// Expected and got.
        because: String,
    },
}

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
