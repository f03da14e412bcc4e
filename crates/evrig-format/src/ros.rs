//! Messages of ROS 1 and ROS 2 that cameras send: events, images and inertial samples.
//!
//! Definitions: `dvs_msgs`, `prophesee_event_msgs`, `event_camera_msgs`, `sensor_msgs`. ROS 1 packs
//! fields without padding; ROS 2 aligns them (CDR, OMG DDSI-RTPS 2.5, section 10). Both are read by
//! one decoder, because the definitions are equal but for the header.

mod cursor;
mod image;
mod packet;

pub(crate) use cursor::{CdrBuilder, MessageCursor, RosWire};

use crate::aedat4::{Content, PayloadKind};
use crate::recording::{RecordingNotes, SourceStream};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_core::imu::ImuSample;
use evrig_core::time::Stamp;
use packet::PacketStream;
use std::collections::BTreeMap;

/// One g in m/s^2, as the drivers of the DAVIS (rpg_dvs_ros) multiply it in.
const STANDARD_GRAVITY: f64 = 9.81;

/// Decodes the messages of one recording.
#[derive(Debug, Default)]
pub(crate) struct RosDecoder {
    /// Topics of `EventPacket`, whose codes go on from one message to the next.
    packets: BTreeMap<String, PacketStream>,
    pub(crate) notes: RecordingNotes,
}

/// What a message holds.
pub(crate) type RosContent = Option<(SourceStream, Content)>;

impl RosDecoder {
    /// Decodes a message of a topic; none for what is left out, which is counted.
    pub(crate) fn take(
        &mut self,
        topic: &str,
        kind: &str,
        wire: RosWire,
        data: &[u8],
    ) -> Result<RosContent, String> {
        let cut = || format!("a message of {topic} is cut or malformed");
        let mut cursor = MessageCursor::new(wire, data).ok_or_else(|| {
            format!("a message of {topic} is not of plain CDR, which ROS 2 writes")
        })?;
        match kind.replace("/msg/", "/").as_str() {
            "dvs_msgs/EventArray" | "prophesee_event_msgs/EventArray" => {
                let (size, events) = event_array(&mut cursor).ok_or_else(cut)?;
                let stream = SourceStream::new(topic, PayloadKind::Events, size);
                Ok(Some((stream, Content::Events(events))))
            }
            "event_camera_msgs/EventPacket" | "event_array_msgs/EventArray" => {
                let stream = self.packets.entry(topic.to_owned()).or_default();
                stream.take(topic, &mut cursor, &mut self.notes)
            }
            "sensor_msgs/Image" => match image::frame(&mut cursor).ok_or_else(cut)? {
                Ok(frame) => {
                    let stream = SourceStream::new(topic, PayloadKind::Frames, Some(frame.size));
                    Ok(Some((stream, Content::Frame(frame))))
                }
                Err(encoding) => {
                    let what = format!("images of {topic} of the encoding {encoding}");
                    self.notes.leave_out(&what, 1);
                    Ok(None)
                }
            },
            "sensor_msgs/Imu" => {
                let sample = imu(&mut cursor).ok_or_else(cut)?;
                let stream = SourceStream::new(topic, PayloadKind::Imu, None);
                Ok(Some((stream, Content::Imu(vec![sample]))))
            }
            _ => {
                self.notes.leave_out(&format!("messages of {topic} ({kind})"), 1);
                Ok(None)
            }
        }
    }
}

/// Width and height, where they are those of a sensor.
fn sensor_size(width: u32, height: u32) -> Option<Size> {
    match (u16::try_from(width), u16::try_from(height)) {
        (Ok(width @ 1..), Ok(height @ 1..)) => Some(Size::new(width, height)),
        _ => None,
    }
}

fn event_array(cursor: &mut MessageCursor<'_>) -> Option<(Option<Size>, Events)> {
    cursor.header()?;
    let (height, width) = (cursor.u32()?, cursor.u32()?);
    let n = cursor.u32()? as usize;
    // The claimed number may be damage; no event is shorter than 13 bytes.
    let mut events = Events::with_capacity(n.min(cursor.n_left() / 13));
    for _ in 0..n {
        let (x, y) = (cursor.u16()?, cursor.u16()?);
        let t = cursor.stamp_ns()?.div_euclid(1_000);
        events.push(Event { t, x, y, on: cursor.u8()? != 0 });
    }
    Some((sensor_size(width, height), events))
}

fn imu(cursor: &mut MessageCursor<'_>) -> Option<ImuSample> {
    let stamp = Stamp::from_nanos(cursor.header()?);
    let mut skip = |n: usize| (0..n).try_for_each(|_| cursor.f64().map(drop));
    // The orientation and its covariance.
    skip(4 + 9)?;
    let rotation = cursor.vector()?;
    (0..9).try_for_each(|_| cursor.f64().map(drop))?;
    let acceleration = cursor.vector()?;
    Some(ImuSample {
        stamp,
        // The message has none.
        temperature_c: f32::NAN,
        acceleration_g: acceleration.map(|a| (a / STANDARD_GRAVITY) as f32),
        rotation_deg_per_s: rotation.map(|w| w.to_degrees() as f32),
        magnetic_ut: [0.0; 3],
    })
}

#[cfg(test)]
pub(crate) mod tests;
