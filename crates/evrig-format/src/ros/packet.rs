//! `event_camera_msgs/EventPacket`: events in the code of their camera.

use super::{MessageCursor, RosContent, sensor_size};
use crate::CameraEvents;
use crate::aedat4::{Content, PayloadKind};
use crate::prophesee::PacketDecoder;
use crate::recording::{RecordingNotes, SourceStream};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;

/// Bytes of an event of the encoding `mono`.
const MONO_BYTES: usize = 8;

/// The packets of one topic.
#[derive(Debug, Default)]
pub(super) struct PacketStream {
    /// The decoder of Prophesee's words, which go on from packet to packet.
    words: Option<PacketDecoder>,
    /// Added to the times of the words, which are the sensor's, µs.
    shift_us: Option<i64>,
}

impl PacketStream {
    pub(super) fn take(
        &mut self,
        topic: &str,
        cursor: &mut MessageCursor<'_>,
        notes: &mut RecordingNotes,
    ) -> Result<RosContent, String> {
        let cut = || format!("a message of {topic} is cut or malformed");
        let mut fields = || {
            let stamp_ns = cursor.header()?;
            let (height, width) = (cursor.u32()?, cursor.u32()?);
            let (_sequence, _time_base) = (cursor.u64()?, cursor.u64()?);
            let encoding = cursor.text()?;
            let is_big_endian = cursor.u8()? != 0;
            Some((stamp_ns, sensor_size(width, height), encoding, is_big_endian, cursor.bytes()?))
        };
        let (stamp_ns, size, encoding, is_big_endian, data) = fields().ok_or_else(cut)?;
        let events = match encoding.as_str() {
            _ if is_big_endian => None,
            "mono" => Some(mono(data, stamp_ns).ok_or_else(cut)?),
            "evt2" | "evt21" | "evt3" => {
                let words = self.words.get_or_insert_with(|| PacketDecoder::new(&encoding));
                let mut found = CameraEvents::default();
                words.decode(data, &mut found);
                found.left_out.iter().for_each(|(what, n)| notes.leave_out(what, *n));
                Some(self.on_ros_clock(topic, found.events, stamp_ns, notes))
            }
            _ => None,
        };
        let Some(events) = events else {
            let order = if is_big_endian { "big-endian " } else { "" };
            let what = format!("packets of {topic} of the encoding {order}{encoding}");
            notes.leave_out(&what, 1);
            return Ok(None);
        };
        Ok(Some((stream(topic, size), Content::Events(events))))
    }

    /// Moves the sensor's times so that the first event is at the stamp of its packet, as the
    /// drivers stamp them.
    fn on_ros_clock(
        &mut self,
        topic: &str,
        mut events: Events,
        stamp_ns: i64,
        notes: &mut RecordingNotes,
    ) -> Events {
        let Some(first) = events.as_slice().t.first() else { return events };
        let shift = *self.shift_us.get_or_insert_with(|| {
            let shift = stamp_ns.div_euclid(1_000).saturating_sub(*first);
            notes.decide(format!(
                "{shift} us are added to the sensor's times of {topic}, so that its first event is \
                 at the stamp of its message"
            ));
            shift
        });
        events.shift(shift);
        events
    }
}

fn stream(topic: &str, size: Option<Size>) -> SourceStream {
    SourceStream::new(topic, PayloadKind::Events, size)
}

/// Words of 64 bits: polarity, 15 bits of y, 16 of x, 32 of ns since the stamp.
fn mono(data: &[u8], stamp_ns: i64) -> Option<Events> {
    let is_whole = data.len().is_multiple_of(MONO_BYTES);
    let event = |word: &[u8]| {
        let word = u64::from_le_bytes(word.try_into().ok()?);
        let t = stamp_ns.saturating_add((word & 0xffff_ffff) as i64).div_euclid(1_000);
        let (x, y) = ((word >> 32) as u16, ((word >> 48) & 0x7fff) as u16);
        Some(Event { t, x, y, on: word >> 63 == 1 })
    };
    is_whole.then(|| data.chunks_exact(MONO_BYTES).filter_map(event).collect())
}
