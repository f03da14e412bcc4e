//! The small messages of the rig's log as values: metadata, clocks, arrivals, poses.

use super::reader::{LoggedMessage, RigLogReader};
use super::records::{ClockExchange, PacketArrival};
use super::{RigLogError, Topic};
use crate::rig::Pose;
use evrig_core::pi_camera::FrameMetadata;
use evrig_core::time::{Stamp, Unix};
use serde::Deserialize;
use std::path::Path;

/// A pose of the tool in the arm's base frame, on the host's wall clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPose {
    /// When it was read, or when the trajectory demands it.
    pub at: Stamp<Unix>,
    /// Position and turn of the tool.
    pub pose: Pose,
}

/// What the rig's log holds beside pictures, each kind in the order of the file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RigNotes {
    /// What the Pi's camera says of each frame.
    pub metadata: Vec<FrameMetadata>,
    /// The Pi's clocks, read between two readings of the host's.
    pub exchanges: Vec<ClockExchange>,
    /// When packets of the event camera reached the host.
    pub arrivals: Vec<PacketArrival>,
    /// Where the arm's planner said the tool was.
    pub poses: Vec<TimedPose>,
    /// Where the trajectory said it was to be.
    pub commanded: Vec<TimedPose>,
}

/// Reads everything but the pictures, up to the end or the first damage.
///
/// # Errors
/// When the file cannot be read, or a message is not what its topic says.
pub(crate) fn read_notes(path: &Path) -> Result<RigNotes, RigLogError> {
    const WANTED: [Topic; 5] =
        [Topic::FrameMetadata, Topic::PiClock, Topic::Arrivals, Topic::ArmPose, Topic::Commanded];
    let mut reader = RigLogReader::open(path, &WANTED)?;
    let mut notes = RigNotes::default();
    while let Some(message) = reader.next() {
        let message = message?;
        notes.take(&message).map_err(|error| reader.malformed(message.topic, error.to_string()))?;
    }
    Ok(notes)
}

impl RigNotes {
    fn take(&mut self, message: &LoggedMessage) -> Result<(), serde_json::Error> {
        let data = &message.data;
        match message.topic {
            Topic::FrameMetadata => self.metadata.push(serde_json::from_slice(data)?),
            Topic::PiClock => self.exchanges.push(serde_json::from_slice(data)?),
            Topic::Arrivals => self.arrivals.push(serde_json::from_slice(data)?),
            Topic::ArmPose => self.poses.push(pose(data)?),
            Topic::Commanded => self.commanded.push(pose(data)?),
            Topic::Raw | Topic::Rgb | Topic::Log => {}
        }
        Ok(())
    }
}

/// foxglove.PoseInFrame in JSON, as the log holds it.
#[derive(Deserialize)]
struct PoseInFrame {
    timestamp: Time,
    pose: FoxglovePose,
}

#[derive(Deserialize)]
struct Time {
    sec: i64,
    nsec: i64,
}

#[derive(Deserialize)]
struct FoxglovePose {
    position: Vector,
    orientation: Turn,
}

#[derive(Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

/// A quaternion about z: the arm's tool turns about nothing else.
#[derive(Deserialize)]
struct Turn {
    z: f64,
    w: f64,
}

fn pose(data: &[u8]) -> Result<TimedPose, serde_json::Error> {
    let PoseInFrame { timestamp, pose } = serde_json::from_slice(data)?;
    let ns = timestamp.sec.saturating_mul(1_000_000_000).saturating_add(timestamp.nsec);
    let Vector { x, y, z } = pose.position;
    let r_deg = (2.0 * pose.orientation.z.atan2(pose.orientation.w)).to_degrees();
    let [x, y, z] = [x, y, z].map(|metres| metres * 1e3);
    Ok(TimedPose { at: Stamp::from_nanos(ns), pose: Pose::from_mm_deg([x, y, z, r_deg]) })
}
