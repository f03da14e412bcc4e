//! Writes events as `event_camera_msgs/EventPacket` of the encoding `evt3`.

use crate::prophesee::Evt3Encoder;
use crate::ros::CdrBuilder;
use evrig_core::event::{Event, EventSlice};
use evrig_core::geometry::Size;
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Time of a packet, µs, as metavision_driver's default.
const PACKET_US: i64 = 10_000;

/// The definition of the message, which readers need for its fields.
const DEFINITION: &str = "\
std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Writes events in ascending time, none before 0, on a sensor of at most 2048 x 2048 pixels. The stamp
/// of a packet is the time of its first event.
///
/// # Errors
/// When the file cannot be written.
pub fn write_packets(
    path: &Path,
    topic: &str,
    events: EventSlice<'_>,
    size: Size,
) -> Result<(), McapError> {
    let file = BufWriter::with_capacity(1 << 20, File::create(path)?);
    let options = WriteOptions::new()
        .profile("ros2")
        // Compressed by this thread alone, so that the bytes do not depend on the machine.
        .compression_threads(0)
        .library(concat!("evrig ", env!("CARGO_PKG_VERSION")));
    let mut file = options.create(file)?;
    let kind = "event_camera_msgs/msg/EventPacket";
    let schema = file.add_schema(kind, "ros2msg", DEFINITION.as_bytes())?;
    let channel_id = file.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
    let mut encoder = Evt3Encoder::default();
    let (mut start, mut sequence) = (0, 0_u32);
    let origin = events.t.first().copied().unwrap_or(0);
    while let Some(&first) = events.t.get(start) {
        let end_us = (first.div_euclid(PACKET_US) + 1) * PACKET_US;
        let end = start + events.t[start..].partition_point(|t| *t < end_us);
        let mut words = Vec::new();
        for event in events.range(start, end).iter() {
            encoder.push(Event { t: event.t - origin, ..event }, &mut words);
        }
        let data = message(&words, first, sequence, size);
        let time = u64::try_from(first).unwrap_or(0).saturating_mul(1_000);
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        file.write_to_known_channel(&header, &data)?;
        start = end;
        sequence = sequence.wrapping_add(1);
    }
    file.finish()?;
    Ok(())
}

fn message(words: &[u8], first_us: i64, sequence: u32, size: Size) -> Vec<u8> {
    let mut message = CdrBuilder::new();
    message.header(first_us.saturating_mul(1_000), "event_camera");
    message.field(u32::from(size.height).to_le_bytes());
    message.field(u32::from(size.width).to_le_bytes());
    // Of evt3 the time is in the words; the field is not used.
    message.field(u64::from(sequence).to_le_bytes()).field(0_u64.to_le_bytes());
    message.text("evt3").field([0]).bytes(words);
    message.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CameraEvents, RecordingSink};
    use evrig_core::event::Events;

    fn planted() -> Events {
        (0..20_000_i64)
            .map(|i| Event {
                t: 1_700_000_000_123_456 + i * 37 + i / 5_000 * 40_000_000,
                x: (i * 7 % 640) as u16,
                y: (i * 3 % 480) as u16,
                on: i % 3 == 0,
            })
            .collect()
    }

    fn read(path: &Path) -> CameraEvents {
        let read = |sink: &mut RecordingSink<'_>| super::super::read(path, sink);
        CameraEvents::gather(path, None, read).unwrap()
    }

    #[test]
    fn packets_are_read_back_and_a_cut_file_up_to_its_cut() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.mcap");
        let events = planted();
        write_packets(&path, "/camera/events", events.as_slice(), Size::new(640, 480)).unwrap();
        let whole = read(&path);
        assert!(whole.events == events);
        assert_eq!((whole.size, whole.damage), (Some(Size::new(640, 480)), None));
        let bytes = std::fs::read(&path).unwrap();
        for n in [bytes.len() - 12, bytes.len() / 2, bytes.len() / 4] {
            std::fs::write(&path, &bytes[..n]).unwrap();
            let read = |sink: &mut RecordingSink<'_>| super::super::read(&path, sink);
            let Ok(cut) = CameraEvents::gather(&path, None, read) else { continue };
            assert!(cut.damage.is_some());
            let n = cut.events.len();
            assert!(cut.events.as_slice() == events.as_slice().range(0, n), "{n}");
        }
    }

    #[test]
    fn a_damaged_chunk_is_left_out_and_the_next_one_read() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.mcap");
        let size = Size::new(640, 480);
        let mut file = File::create(&path).unwrap();
        let options = WriteOptions::new().compression(None).chunk_size(Some(2_000));
        let mut writer = options.create(BufWriter::new(&mut file)).unwrap();
        let schema =
            writer.add_schema("event_camera_msgs/msg/EventPacket", "ros2msg", b"").unwrap();
        let channel_id = writer.add_channel(schema, "/e", "cdr", &BTreeMap::new()).unwrap();
        for k in 0..40_i64 {
            let mut words = Vec::new();
            let mut encoder = Evt3Encoder::default();
            for i in 0..30 {
                encoder.push(Event { t: 1_000 * k + i, x: i as u16, y: 1, on: true }, &mut words);
            }
            let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
            writer.write_to_known_channel(&header, &message(&words, 1_000 * k, 0, size)).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 3;
        bytes[middle] ^= 0xff;
        std::fs::write(&path, &bytes).unwrap();
        let found = read(&path);
        assert!(found.damage.unwrap().contains("checksum"));
        let n = found.events.len();
        assert!(n < 1_200 && n > 600, "{n}");
        assert_eq!(found.events.as_slice().t.last(), Some(&39_029));
    }
}
