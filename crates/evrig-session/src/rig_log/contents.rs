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

/// The contents of the rig's log other than images, each kind in file order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RigLogContents {
    /// Metadata of the Pi's frames.
    pub metadata: Vec<FrameMetadata>,
    /// The Pi's clocks, read between two readings of the host's.
    pub exchanges: Vec<ClockExchange>,
    /// When packets of the event camera reached the host.
    pub arrivals: Vec<PacketArrival>,
    /// Poses reported by the arm.
    pub poses: Vec<TimedPose>,
    /// Poses commanded by the trajectory.
    pub commanded: Vec<TimedPose>,
}

/// Reads everything but the images, up to the end or the first damage.
///
/// # Errors
/// When the file cannot be read, or a message is not of its topic's schema.
pub(crate) fn read_contents(path: &Path) -> Result<RigLogContents, RigLogError> {
    const WANTED: [Topic; 5] =
        [Topic::FrameMetadata, Topic::PiClock, Topic::Arrivals, Topic::ArmPose, Topic::Commanded];
    let mut reader = RigLogReader::open(path, &WANTED)?;
    let mut notes = RigLogContents::default();
    while let Some(message) = reader.next() {
        let message = message?;
        notes.take(&message).map_err(|error| reader.malformed(message.topic, error.to_string()))?;
    }
    Ok(notes)
}

impl RigLogContents {
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

/// A quaternion about z, the only axis of the tool's rotation.
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
