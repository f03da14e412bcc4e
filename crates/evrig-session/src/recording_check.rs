//! The recording check of a dry run: what is recorded is decoded, counted, checked for order,
//! summed and discarded. Two pipes replace the files.

mod checksum;

pub use checksum::{EventChecksum, ImageChecksum};

use super::PacketArrival;
use super::rig_log::{Topic, decode_image, each_message_of};
use evrig_core::event::EventSlice;
use evrig_core::pi_camera::FrameMetadata;
use evrig_format::aedat4::{Content, Reader};
use std::io::Read;

/// Counts and checksums of what was read from the two pipes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordingCheck {
    /// Number of events.
    pub n_events: u64,
    /// Checksum of the events' columns ([`EventChecksum`]).
    pub event_sum: u64,
    /// Frames, inertial samples and triggers of the event camera.
    pub n_others: u64,
    /// Raw frames.
    pub n_raw: u64,
    /// Checksum of their samples, 16 bits little-endian ([`ImageChecksum`]).
    pub raw_sum: u64,
    /// RGB frames.
    pub n_rgb: u64,
    /// Checksum of their bytes.
    pub rgb_sum: u64,
    /// Bytes of both files.
    pub n_bytes: u64,
    /// Problems found; the first of each kind.
    pub problems: Vec<String>,
}

/// Counts the bytes read.
#[derive(Debug)]
struct CountingReader<R> {
    source: R,
    n_bytes: u64,
}

impl<R: Read> Read for CountingReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.source.read(buffer)?;
        self.n_bytes += n as u64;
        Ok(n)
    }
}

impl RecordingCheck {
    /// Reads an event camera's file out of a pipe, to its end.
    #[must_use]
    pub fn of_davis(pipe: impl Read) -> Self {
        let mut check = Self::default();
        let mut counted = CountingReader { source: pipe, n_bytes: 0 };
        let mut sum = EventChecksum::default();
        match Reader::new(&mut counted, "the pipe of davis.aedat4") {
            Ok(mut reader) => {
                let mut last_us = i64::MIN;
                while let Some(packet) = reader.next() {
                    match packet {
                        Ok(packet) => match packet.content {
                            Content::Events(events) => {
                                check.take_events(events.as_slice(), &mut last_us);
                                sum.take(events.as_slice());
                                reader.recycle(events);
                            }
                            Content::Frame(_) => check.n_others += 1,
                            Content::Imu(samples) => check.n_others += samples.len() as u64,
                            Content::Triggers(marks) => check.n_others += marks.len() as u64,
                            Content::Unknown { .. } => {
                                check.note("a packet of an unknown kind");
                            }
                        },
                        Err(error) => check.note(&error.to_string()),
                    }
                }
                if !reader.losses().is_none() {
                    let text = format!("davis.aedat4: {:?}", reader.losses());
                    check.note(&text);
                }
            }
            Err(error) => check.note(&error.to_string()),
        }
        check.event_sum = sum.value();
        check.n_bytes = counted.n_bytes;
        check
    }

    /// Reads a rig's log out of a pipe, to its end; the log's own count of events comes back too.
    #[must_use]
    pub fn of_rig_log(pipe: impl Read) -> (Self, u64) {
        let mut check = Self::default();
        let mut counted = CountingReader { source: pipe, n_bytes: 0 };
        let [mut raw, mut rgb] = [ImageChecksum::default(), ImageChecksum::default()];
        let mut n_arrived = 0;
        let mut next: Option<u64> = None;
        let read = each_message_of(&mut counted, &mut |topic, _, data| match topic {
            Topic::Raw | Topic::Rgb => match decode_image(data) {
                Some(image) if topic == Topic::Raw => {
                    check.n_raw += 1;
                    raw.take(&image);
                }
                Some(image) => {
                    check.n_rgb += 1;
                    rgb.take(&image);
                }
                None => check.note("rig.mcap: a message that is not an image"),
            },
            Topic::FrameMetadata => match serde_json::from_slice::<FrameMetadata>(data) {
                Ok(metadata) => {
                    if next.is_some_and(|next| next != metadata.sequence) {
                        check.note("rig.mcap: frames do not follow one another");
                    }
                    next = Some(metadata.sequence + 1);
                }
                Err(error) => check.note(&format!("rig.mcap: {error}")),
            },
            Topic::Arrivals => match serde_json::from_slice::<PacketArrival>(data) {
                Ok(arrival) => n_arrived += arrival.count,
                Err(error) => check.note(&format!("rig.mcap: {error}")),
            },
            Topic::PiClock | Topic::ArmPose | Topic::Commanded | Topic::Log => {}
        });
        match read {
            Ok(Some(damage)) => check.note(&format!("rig.mcap: {damage}")),
            Err(error) => check.note(&format!("rig.mcap: {error}")),
            Ok(None) => {}
        }
        (check.raw_sum, check.rgb_sum, check.n_bytes) = (raw.value(), rgb.value(), counted.n_bytes);
        (check, n_arrived)
    }

    /// The results of both files together.
    #[must_use]
    pub fn joined(davis: Self, (log, n_arrived): (Self, u64)) -> Self {
        let mut check = Self {
            n_events: davis.n_events,
            event_sum: davis.event_sum,
            n_others: davis.n_others,
            n_bytes: davis.n_bytes + log.n_bytes,
            problems: davis.problems,
            ..log
        };
        check.problems.extend(log.problems);
        let n_written = check.n_events + check.n_others;
        if n_arrived != n_written {
            check.note(&format!("{n_arrived} samples arrived, {n_written} were written"));
        }
        check
    }

    fn take_events(&mut self, events: EventSlice<'_>, last_us: &mut i64) {
        self.n_events += events.len() as u64;
        let is_sorted = events.t.is_sorted();
        if !is_sorted || events.t.first().is_some_and(|first| first < last_us) {
            self.note("davis.aedat4: events are not in order of time");
        }
        *last_us = events.t.last().copied().unwrap_or(*last_us);
    }

    fn note(&mut self, problem: &str) {
        if !self.problems.iter().any(|known| known == problem) && self.problems.len() < 20 {
            self.problems.push(problem.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HostTime, RigLogWriter};
    use evrig_core::event::{Event, Events};
    use evrig_core::geometry::Size;
    use evrig_core::pi_camera::PiFrame;
    use evrig_core::time::{Span, Stamp};
    use evrig_format::Destination;
    use evrig_format::aedat4::{Compression, StreamSpec, Writer};
    use std::io::Write;
    use std::path::Path;

    fn events(times: &[i64]) -> Events {
        times.iter().map(|&t| Event { t, x: t as u16, y: 3, on: t % 2 == 0 }).collect()
    }

    /// What a reader at the other end of the pipe receives from a writer at this end.
    fn read_through_pipe<T: Send>(
        write: impl FnOnce(Box<dyn Write + Send>),
        read: impl FnOnce(std::io::PipeReader) -> T + Send,
    ) -> T {
        let (reader, writer) = std::io::pipe().unwrap();
        std::thread::scope(|scope| {
            let reading = scope.spawn(|| read(reader));
            write(Box::new(writer));
            reading.join().unwrap()
        })
    }

    fn davis(packets: &[Events]) -> RecordingCheck {
        let streams = [StreamSpec::events(Size::DAVIS346, "check")];
        let write = |pipe| {
            let pipe = Destination::pipe(pipe);
            let mut writer =
                Writer::as_recorded(pipe, "pipe", Compression::None, &streams).unwrap();
            packets.iter().for_each(|events| writer.write_events(0, events.as_slice()).unwrap());
        };
        read_through_pipe(write, RecordingCheck::of_davis)
    }

    #[test]
    fn what_was_written_is_what_is_received() {
        let packets = [events(&[1, 2, 3]), events(&[3, 9])];
        let check = davis(&packets);
        let mut sum = EventChecksum::default();
        sum.take(events(&[1, 2, 3, 3, 9]).as_slice());
        assert_eq!((check.n_events, check.event_sum), (5, sum.value()));
        assert_eq!(check.problems, Vec::<String>::new());
    }

    #[test]
    fn events_that_go_back_in_time_are_reported_and_one_changed_bit_changes_the_sum() {
        let check = davis(&[events(&[5, 6]), events(&[4])]);
        assert!(check.problems[0].contains("not in order"), "{:?}", check.problems);
        let [one, other] = [[1, 2, 3], [1, 2, 4]].map(|times| davis(&[events(&times)]).event_sum);
        assert_ne!(one, other);
    }

    fn log(sequences: &[u64], n_arrived: u64) -> (RecordingCheck, u64) {
        let at = HostTime { monotonic: Stamp::from_micros(7), unix: Stamp::from_micros(7) };
        let size = Size::new(4, 1);
        let write = |pipe| {
            let mut log = RigLogWriter::to_pipe(pipe, Path::new("pipe")).unwrap();
            for &sequence in sequences {
                let metadata = FrameMetadata {
                    sequence,
                    sensor_timestamp: Stamp::from_micros(sequence as i64),
                    frame_wall_clock: None,
                    real_time: Stamp::from_micros(sequence as i64),
                    exposure: Span::from_micros(1),
                    analogue_gain: 1.0,
                    digital_gain: 1.0,
                    lens_position: None,
                    black_levels: [64; 4],
                    size,
                    bayer: "RGGB".to_owned(),
                    n_dropped: 0,
                };
                let raw10 = evrig_core::raw10::pack(&[1, 2, 3, 1023], size).unwrap();
                let frame = PiFrame { metadata, raw10: Some(raw10), rgb: Some(vec![9; 12]) };
                log.frame(&frame, at).unwrap();
            }
            let arrival =
                PacketArrival { stream: 0, count: n_arrived, first_us: 0, last_us: 1, arrived: at };
            log.arrival(&arrival).unwrap();
            log.finish().unwrap();
        };
        read_through_pipe(write, RecordingCheck::of_rig_log)
    }

    #[test]
    fn images_are_received_unchanged_and_a_gap_between_them_is_reported() {
        let (check, _) = log(&[4, 5], 0);
        let mut sum = ImageChecksum::default();
        sum.take(&[1, 0, 2, 0, 3, 0, 255, 3, 1, 0, 2, 0, 3, 0, 255, 3]);
        assert_eq!((check.n_raw, check.n_rgb, check.raw_sum), (2, 2, sum.value()));
        assert_eq!(check.problems, Vec::<String>::new());
        let (check, _) = log(&[4, 6], 0);
        assert!(check.problems[0].contains("do not follow"), "{:?}", check.problems);
    }

    #[test]
    fn events_that_arrived_and_were_not_written_are_reported() {
        let both = RecordingCheck::joined(davis(&[events(&[1, 2])]), log(&[0], 2));
        assert_eq!(both.problems, Vec::<String>::new());
        let both = RecordingCheck::joined(davis(&[events(&[1, 2])]), log(&[0], 3));
        assert!(both.problems[0].contains("3 samples arrived, 2 were written"));
    }
}
