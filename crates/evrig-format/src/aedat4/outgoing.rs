//! A packet to be written: header and payload in one buffer, which is reused.

use super::compression::{Compression, compress, with_scratch};
use super::cut::cut_into_packets;
use super::{Content, PayloadKind, encode};
use evrig_core::event::EventSlice;
use evrig_core::frame::Frame;
use evrig_core::imu::{ImuSample, Trigger};
use evrig_core::time::Davis;
use std::io;

/// Bytes of a packet's stream and length, before its payload.
pub(super) const HEAD_BYTES: usize = 8;

/// Samples or triggers in a packet at most.
const SAMPLE_PACKET_LENGTH: usize = 1 << 12;

/// Largest column or row that AEDAT4 can hold.
const MAX_COORDINATE: u16 = i16::MAX as u16;

/// What is written of a stream: a content, or the part of it that becomes one packet.
#[derive(Debug, Clone, Copy)]
pub(super) enum PacketInput<'a> {
    Events(EventSlice<'a>),
    Frame(&'a Frame<Davis>),
    Imu(&'a [ImuSample]),
    Triggers(&'a [Trigger]),
}

impl<'a> PacketInput<'a> {
    /// A content; none of an unknown kind.
    pub(super) fn of(content: &'a Content) -> Option<Self> {
        Some(match content {
            Content::Events(events) => Self::Events(events.as_slice()),
            Content::Frame(frame) => Self::Frame(frame),
            Content::Imu(samples) => Self::Imu(samples),
            Content::Triggers(marks) => Self::Triggers(marks),
            Content::Unknown { .. } => return None,
        })
    }

    /// The kind of the stream, and a word for it.
    pub(super) fn kind(self) -> (PayloadKind, &'static str) {
        match self {
            Self::Events(_) => (PayloadKind::Events, "events"),
            Self::Frame(_) => (PayloadKind::Frames, "frames"),
            Self::Imu(_) => (PayloadKind::Imu, "inertial samples"),
            Self::Triggers(_) => (PayloadKind::Triggers, "triggers"),
        }
    }

    /// What AEDAT4 cannot hold; none where it holds all.
    pub(super) fn unrepresentable(self) -> Option<String> {
        match self {
            Self::Events(events) => {
                let union = |column: &[u16]| column.iter().fold(0, |union, c| union | c);
                if union(events.x) | union(events.y) <= MAX_COORDINATE {
                    return None;
                }
                let is_beyond = |i: &usize| events.x[*i].max(events.y[*i]) > MAX_COORDINATE;
                let i = (0..events.len()).find(is_beyond)?;
                Some(format!("event {i} at x {}, y {}", events.x[i], events.y[i]))
            }
            Self::Frame(frame) => {
                let (size, n) = (frame.size, frame.samples.len());
                let expected = size.n_pixels() * frame.channels.count();
                if size.width.max(size.height) > MAX_COORDINATE {
                    return Some(format!("a frame of {size} pixels"));
                }
                (n != expected).then(|| format!("a frame of {n} samples that needs {expected}"))
            }
            Self::Imu(_) | Self::Triggers(_) => None,
        }
    }

    /// The parts that become a packet each.
    pub(super) fn cut(self) -> Vec<Self> {
        match self {
            Self::Events(events) => {
                let part = |[start, end]: [usize; 2]| Self::Events(events.range(start, end));
                cut_into_packets(events).into_iter().map(part).collect()
            }
            Self::Frame(_) => vec![self],
            Self::Imu(samples) => samples.chunks(SAMPLE_PACKET_LENGTH).map(Self::Imu).collect(),
            Self::Triggers(marks) => {
                marks.chunks(SAMPLE_PACKET_LENGTH).map(Self::Triggers).collect()
            }
        }
    }

    fn n_elements(self) -> usize {
        match self {
            Self::Events(run) => run.len(),
            Self::Frame(_) => 1,
            Self::Imu(samples) => samples.len(),
            Self::Triggers(marks) => marks.len(),
        }
    }

    /// Earliest and latest time, µs; zeros for none.
    fn span_us(self) -> [i64; 2] {
        match self {
            Self::Events(run) => span(run.t.iter().copied()),
            Self::Frame(frame) => [frame.timing.stamp.as_micros(); 2],
            Self::Imu(samples) => span(samples.iter().map(|sample| sample.stamp.as_micros())),
            Self::Triggers(marks) => span(marks.iter().map(|mark| mark.stamp.as_micros())),
        }
    }
}

/// One packet, ready to be written.
#[derive(Debug, Default)]
pub(super) struct PacketBuffer {
    /// Head and payload; may be longer than the packet, because growing clears memory.
    bytes: Vec<u8>,
    /// Bytes of the packet.
    n_bytes: usize,
    pub(super) n_elements: usize,
    pub(super) span_us: [i64; 2],
}

impl PacketBuffer {
    /// Encodes and compresses.
    pub(super) fn fill(
        &mut self,
        compression: Compression,
        input: PacketInput<'_>,
    ) -> io::Result<()> {
        let out = &mut self.bytes;
        self.n_bytes = match (input, compression) {
            (PacketInput::Events(run), Compression::None) => encode::events(run, out, HEAD_BYTES),
            (PacketInput::Events(run), _) => with_scratch(|plain| {
                let n = encode::events(run, plain, 0);
                compress(compression, &plain[..n], out, HEAD_BYTES)
            })?,
            (PacketInput::Frame(frame), _) => {
                compress(compression, &encode::frame(frame), out, HEAD_BYTES)?
            }
            (PacketInput::Imu(samples), _) => {
                compress(compression, &encode::imu(samples), out, HEAD_BYTES)?
            }
            (PacketInput::Triggers(marks), _) => {
                compress(compression, &encode::triggers(marks), out, HEAD_BYTES)?
            }
        };
        (self.n_elements, self.span_us) = (input.n_elements(), input.span_us());
        Ok(())
    }

    /// Bytes of the payload.
    pub(super) fn payload_bytes(&self) -> u32 {
        self.n_bytes.saturating_sub(HEAD_BYTES) as u32
    }

    /// The packet as written to a file.
    pub(super) fn finish(&mut self, stream: u32) -> &[u8] {
        let length = self.payload_bytes();
        if let Some((head, _)) = self.bytes.split_first_chunk_mut::<HEAD_BYTES>() {
            *head = (u64::from(length) << 32 | u64::from(stream)).to_le_bytes();
        }
        &self.bytes[..self.n_bytes]
    }
}

/// Earliest and latest of some times, zeros for none.
fn span(mut times: impl Iterator<Item = i64>) -> [i64; 2] {
    let Some(first) = times.next() else { return [0; 2] };
    times.fold([first; 2], |[earliest, latest], t| [earliest.min(t), latest.max(t)])
}
