//! AEDAT 3.1, the format of cAER and libcaer: packets of one kind of event each, little-endian.
//!
//! Layout: <https://docs.inivation.com> (file formats, AEDAT 3.1).

use crate::aedat4::{Content, PayloadKind};
use crate::recording::{RecordingNotes, RecordingSink, SourceStream};
use crate::{BLOCK_BYTES, CameraFileError};
use evrig_core::event::{Event, Events};
use evrig_core::frame::{Channels, Frame, FrameTiming, Samples};
use evrig_core::geometry::Size;
use evrig_core::imu::ImuSample;
use evrig_core::time::{Davis, Stamp};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Kind, source, size, time offset, overflow, capacity, number, valid.
const PACKET_HEADER_BYTES: usize = 28;

/// Packets of more bytes are damage.
const MAX_PACKET_BYTES: u64 = 1 << 28;

const SPECIAL_KIND: u16 = 0;
const POLARITY_KIND: u16 = 1;
const FRAME_KIND: u16 = 2;
const IMU6_KIND: u16 = 3;
const IMU9_KIND: u16 = 4;

/// Bytes of a frame in front of its pixels: facts, four times, size and place.
const FRAME_HEADER_BYTES: usize = 36;

/// Whether the first bytes of a file are those of AEDAT 3.
#[must_use]
pub fn is_header(start: &[u8]) -> bool {
    start.starts_with(b"#!AER-DAT3")
}

/// Reads a file, up to a cut.
///
/// # Errors
/// When the file cannot be read, or the sink refuses.
pub fn read(path: &Path, sink: &mut RecordingSink<'_>) -> Result<RecordingNotes, CameraFileError> {
    let io = CameraFileError::io;
    let mut reader = BufReader::with_capacity(BLOCK_BYTES, File::open(path).map_err(io(path))?);
    let mut line = Vec::new();
    loop {
        line.clear();
        reader.read_until(b'\n', &mut line).map_err(io(path))?;
        if line.starts_with(b"#!END-HEADER") {
            break;
        }
        if line.is_empty() || line[0] != b'#' {
            let what = "has no end of its header; expected a line `#!END-HEADER`";
            return Err(CameraFileError::format(path, what));
        }
    }
    let mut notes = RecordingNotes::default();
    for number in 0_u64.. {
        let mut header = Vec::new();
        let n = PACKET_HEADER_BYTES as u64;
        reader.by_ref().take(n).read_to_end(&mut header).map_err(io(path))?;
        if header.is_empty() {
            break;
        }
        if header.len() < PACKET_HEADER_BYTES {
            notes.damage = Some(format!("the file is cut in the header of packet {number}"));
            break;
        }
        let kind = u16::from_le_bytes([header[0], header[1]]);
        let [size, overflow, n] = [4, 12, 20].map(|at| u64::from(word(&header, at)));
        let n_bytes = size.saturating_mul(n);
        if size < 8 || n_bytes > MAX_PACKET_BYTES {
            notes.damage = Some(format!("packet {number} claims {n} events of {size} bytes"));
            break;
        }
        let mut body = Vec::new();
        reader.by_ref().take(n_bytes).read_to_end(&mut body).map_err(io(path))?;
        let packet = EventPacket { kind, size: size as usize, n, overflow, body: &body };
        packet.give(&mut notes, sink)?;
        if (body.len() as u64) < n_bytes {
            notes.damage = Some(format!("the file is cut in packet {number}"));
            break;
        }
    }
    Ok(notes)
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4].iter().rev().fold(0, |bits, byte| (bits << 8) | u32::from(*byte))
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(word(bytes, at))
}

/// A packet of events of one kind.
struct EventPacket<'a> {
    kind: u16,
    /// Bytes of an event.
    size: usize,
    n: u64,
    /// How often the times of 31 bits wrapped.
    overflow: u64,
    body: &'a [u8],
}

impl EventPacket<'_> {
    fn give(
        &self,
        notes: &mut RecordingNotes,
        sink: &mut RecordingSink<'_>,
    ) -> Result<(), CameraFileError> {
        let n_whole = (self.body.len() / self.size) as u64;
        match (self.kind, self.size) {
            (POLARITY_KIND, 8) => {
                sink(&SourceStream::only_events(None), Content::Events(self.events(notes)))
            }
            (FRAME_KIND, FRAME_HEADER_BYTES..) => {
                for event in self.body.chunks_exact(self.size) {
                    let Some(frame) = self.frame(event, notes) else { continue };
                    let size = Some(frame.size);
                    let stream = SourceStream::new("frames", PayloadKind::Frames, size);
                    sink(&stream, Content::Frame(frame))?;
                }
                Ok(())
            }
            (IMU6_KIND, 36) | (IMU9_KIND, 48) => {
                let samples = self.samples(notes);
                let stream = SourceStream::new("imu", PayloadKind::Imu, None);
                sink(&stream, Content::Imu(samples))
            }
            (SPECIAL_KIND, _) => {
                notes.leave_out("special events", n_whole);
                Ok(())
            }
            _ => {
                notes.leave_out(&format!("events of kind {}", self.kind), self.n);
                Ok(())
            }
        }
    }

    /// Whether an event is valid; an invalid one is counted.
    fn is_valid(event: &[u8], notes: &mut RecordingNotes) -> bool {
        let is_valid = event[0] & 1 == 1;
        if !is_valid {
            let what = "events that a filter of the camera's program marked as invalid";
            notes.leave_out(what, 1);
        }
        is_valid
    }

    fn t(&self, stamp: u32) -> i64 {
        ((self.overflow as i64) << 31) + i64::from(stamp & 0x7fff_ffff)
    }

    fn events(&self, notes: &mut RecordingNotes) -> Events {
        let events = self.body.chunks_exact(8).filter(|event| Self::is_valid(event, notes));
        let decoded = events.map(|event| {
            let (data, t) = (word(event, 0), self.t(word(event, 4)));
            let (x, y) = ((data >> 17) as u16, ((data >> 2) & 0x7fff) as u16);
            Event { t, x, y, on: data & 2 != 0 }
        });
        decoded.collect()
    }

    /// Facts, start and end of the frame, start and end of the exposure, width, height, column, row.
    fn frame(&self, event: &[u8], notes: &mut RecordingNotes) -> Option<Frame<Davis>> {
        if !Self::is_valid(event, notes) {
            return None;
        }
        let facts = word(event, 0);
        let [begin, _end, open, close] = [4, 8, 12, 16].map(|at| self.t(word(event, at)));
        let side = |at: usize| u16::try_from(word(event, at)).ok().filter(|side| *side > 0);
        let channels = match (facts >> 1) & 7 {
            1 => Some(Channels::Gray),
            3 => Some(Channels::Bgr),
            4 => Some(Channels::Bgra),
            _ => None,
        };
        let (Some(width), Some(height), Some(channels)) = (side(20), side(24), channels) else {
            notes.leave_out("frames of a size or of channels that are unknown", 1);
            return None;
        };
        let size = Size::new(width, height);
        let n_bytes = 2 * size.n_pixels() * channels.count();
        let Some(pixels) = event[FRAME_HEADER_BYTES..].get(..n_bytes) else {
            notes.leave_out("frames without all their pixels", 1);
            return None;
        };
        let mut samples: Vec<u16> =
            pixels.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
        if channels != Channels::Gray {
            samples.chunks_exact_mut(channels.count()).for_each(|pixel| pixel.swap(0, 2));
        } else if (facts >> 4) & 0xf != 0 {
            notes.decide("the frames are mosaics of a colour sensor, kept as they are".into());
        }
        let is_exposed = open <= close && open >= begin;
        let exposure = is_exposed.then(|| [open, close].map(Stamp::from_micros));
        let stamp = if is_exposed { open + (close - open) / 2 } else { begin };
        let stamp = Stamp::from_micros(stamp);
        let timing = FrameTiming { exposure, ..FrameTiming::from_stamp(stamp) };
        let origin = [28, 32].map(|at| i16::try_from(word(event, at)).unwrap_or(0));
        Some(Frame { timing, size, origin, channels, samples: Samples::U16(samples) })
    }

    /// Facts, time, acceleration (g), rotation (deg/s), temperature, and with a compass its field.
    fn samples(&self, notes: &mut RecordingNotes) -> Vec<ImuSample> {
        let events = self.body.chunks_exact(self.size).filter(|event| Self::is_valid(event, notes));
        let has_compass = self.kind == IMU9_KIND;
        let sample = |event: &[u8]| {
            let axes = |at: usize| [0, 4, 8].map(|axis| float(event, at + axis));
            ImuSample {
                stamp: Stamp::from_micros(self.t(word(event, 4))),
                temperature_c: float(event, 32),
                acceleration_g: axes(8),
                rotation_deg_per_s: axes(20),
                magnetic_ut: if has_compass { axes(36) } else { [0.0; 3] },
            }
        };
        events.map(sample).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraEvents;

    fn packet(kind: u16, overflow: u32, events: &[[u32; 2]]) -> Vec<u8> {
        let n = events.len() as u32;
        let words = [8, 4, overflow, n, n, n];
        let head = [kind.to_le_bytes(), 1_u16.to_le_bytes()].concat();
        let words = words.iter().chain(events.iter().flatten()).flat_map(|w| w.to_le_bytes());
        head.into_iter().chain(words).collect()
    }

    #[test]
    fn polarity_packets_are_read_up_to_a_cut() {
        let event = |x: u32, y: u32, on: u32| (x << 17) | (y << 2) | (on << 1) | 1;
        let mut bytes = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#!END-HEADER\r\n".to_vec();
        bytes.extend(packet(1, 0, &[[event(345, 259, 1), 10], [0, 11]]));
        bytes.extend(packet(0, 0, &[[3, 12]]));
        bytes.extend(packet(1, 1, &[[event(1, 2, 0), 5], [event(9, 9, 0), 6]]));
        bytes.truncate(bytes.len() - 3);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat");
        std::fs::write(&path, &bytes).unwrap();
        let found = CameraEvents::gather(&path, None, |sink| super::read(&path, sink)).unwrap();
        let rows: Vec<(i64, u16, u16, bool)> =
            found.events.as_slice().iter().map(|e| (e.t, e.x, e.y, e.on)).collect();
        assert_eq!(rows, [(10, 345, 259, true), ((1 << 31) + 5, 1, 2, false)]);
        assert_eq!(found.left_out.len(), 2);
        assert!(found.damage.unwrap().contains("cut in packet 2"));
    }

    #[test]
    fn frames_and_inertial_samples_have_their_times_and_values() {
        let mut bytes = b"#!AER-DAT3.1\r\n#!END-HEADER\r\n".to_vec();
        let mut put = |kind: u16, overflow: u32, body: &[u8]| {
            bytes.extend([kind.to_le_bytes(), 1_u16.to_le_bytes()].concat());
            let words = [body.len() as u32, 4, overflow, 1, 1, 1];
            bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
            bytes.extend(body);
        };
        // One channel, valid; frame 10 to 90, exposed 20 to 60; 2 x 1 pixels at (3, 4).
        let words: Vec<u8> =
            [0b11_u32, 10, 90, 20, 60, 2, 1, 3, 4].iter().flat_map(|w| w.to_le_bytes()).collect();
        let pixels = [512_u16, 65_535].map(u16::to_le_bytes).concat();
        put(FRAME_KIND, 1, &[words, pixels].concat());
        let mut imu: Vec<u8> = [1_u32, 7].iter().flat_map(|w| w.to_le_bytes()).collect();
        imu.extend([1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0, 36.5].iter().flat_map(|v| v.to_le_bytes()));
        put(IMU6_KIND, 0, &imu);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat");
        std::fs::write(&path, &bytes).unwrap();
        let mut found = Vec::new();
        let sink = &mut |_: &SourceStream, content| {
            found.push(content);
            Ok(())
        };
        super::read(&path, sink).unwrap();
        let [Content::Frame(frame), Content::Imu(samples)] = found.as_slice() else {
            panic!("expected a frame and a sample: {found:?}")
        };
        let exposure = frame.timing.exposure.unwrap().map(|stamp| stamp.as_micros());
        assert_eq!(exposure, [(1 << 31) + 20, (1 << 31) + 60]);
        assert_eq!((frame.size, frame.origin), (Size::new(2, 1), [3, 4]));
        assert_eq!(frame.samples, Samples::U16(vec![512, 65_535]));
        assert_eq!(samples[0].acceleration_g, [1.0, 2.0, 3.0]);
        assert_eq!(samples[0].rotation_deg_per_s, [4.0, 5.0, 6.0]);
        assert_eq!(samples[0].temperature_c, 36.5);
    }
}
