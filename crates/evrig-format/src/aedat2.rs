//! AEDAT 2.0, the format of jAER and of v2e: pairs of an address and a time, 32 bits each,
//! big-endian, behind lines that begin with `#`.
//!
//! The address depends on the chip, which the header names. Rows and columns count from the corner
//! opposite to that of images. Layouts: <https://docs.inivation.com> (file formats, AEDAT 2.0).

mod samples;

use crate::aedat4::{Content, PayloadKind};
use crate::recording::{RecordingNotes, RecordingSink, SourceStream};
use crate::{BLOCK_BYTES, CameraFileError};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_core::imu::ImuSample;
use samples::{FrameSamples, ImuWords};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Bytes of an address and its time.
const PAIR_BYTES: usize = 8;

/// How an address is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AddressLayout {
    /// Bit 31: not an event; 9 bits of y, 10 of x, polarity, a special event.
    Davis,
    /// 7 bits of y, 7 of x, polarity (reversed).
    Dvs128,
}

/// Whether the first bytes of a file are those of AEDAT 2.0, or of 1.0 without a version.
#[must_use]
pub fn is_header(start: &[u8]) -> bool {
    start.starts_with(b"#!AER-DAT2")
}

/// Reads a file. `size` replaces the size of the chip that the header names.
///
/// # Errors
/// When the file cannot be read, or neither the header nor `size` states the chip, or the sink refuses.
pub fn read(
    path: &Path,
    size: Option<Size>,
    sink: &mut RecordingSink<'_>,
) -> Result<RecordingNotes, CameraFileError> {
    let io = CameraFileError::io;
    let mut reader = BufReader::with_capacity(BLOCK_BYTES, File::open(path).map_err(io(path))?);
    let mut header = String::new();
    while reader.fill_buf().map_err(io(path))?.first() == Some(&b'#') {
        let mut line = Vec::new();
        reader.read_until(b'\n', &mut line).map_err(io(path))?;
        header.push_str(&String::from_utf8_lossy(&line).to_lowercase());
    }
    let (layout, stated) = chip(&header);
    let (Some(layout), Some(size)) = (layout.or(size.map(layout_of)), size.or(stated)) else {
        let what = "has a header that names no chip that is known; give the sensor's --size";
        return Err(CameraFileError::format(path, what));
    };
    let mut decoder = PairDecoder::new(layout, size);
    decoder.notes.decide(format!("addresses are those of a {layout:?} of {size} pixels"));
    let mut block = Vec::new();
    loop {
        block.clear();
        let n_bytes = BLOCK_BYTES as u64;
        let n = reader.by_ref().take(n_bytes).read_to_end(&mut block).map_err(io(path))?;
        decoder.decode(&block, sink)?;
        if (n as u64) < n_bytes {
            let n_left = n % PAIR_BYTES;
            let cut = || format!("the file is cut: {n_left} bytes of a last event were left out");
            let mut notes = decoder.finish();
            notes.damage = (n_left > 0).then(cut);
            return Ok(notes);
        }
    }
}

/// The chip that a header names.
fn chip(header: &str) -> (Option<AddressLayout>, Option<Size>) {
    let known = [
        ("davis346", AddressLayout::Davis, Size::new(346, 260)),
        ("davis240", AddressLayout::Davis, Size::new(240, 180)),
        ("davis640", AddressLayout::Davis, Size::new(640, 480)),
        ("dvs128", AddressLayout::Dvs128, Size::new(128, 128)),
        ("tmpdiff128", AddressLayout::Dvs128, Size::new(128, 128)),
    ];
    let found = known.into_iter().find(|(name, ..)| header.contains(name));
    found.map_or((None, None), |(_, layout, size)| (Some(layout), Some(size)))
}

fn layout_of(size: Size) -> AddressLayout {
    if size == Size::new(128, 128) { AddressLayout::Dvs128 } else { AddressLayout::Davis }
}

/// Times of 32 bits, which wrap after 36 or 72 minutes.
#[derive(Debug, Default)]
struct WrappingClock {
    last: Option<u32>,
    n_wraps: i64,
}

impl WrappingClock {
    fn at(&mut self, t: u32) -> i64 {
        let is_wrap = self.last.is_some_and(|last| last > t && last - t > u32::MAX / 2);
        self.n_wraps += i64::from(is_wrap);
        self.last = Some(t);
        (self.n_wraps << 32) + i64::from(t)
    }
}

/// Decodes pairs.
struct PairDecoder {
    layout: AddressLayout,
    size: Size,
    clock: WrappingClock,
    frame: FrameSamples,
    imu: ImuWords,
    notes: RecordingNotes,
}

impl PairDecoder {
    fn new(layout: AddressLayout, size: Size) -> Self {
        let (clock, notes) = (WrappingClock::default(), RecordingNotes::default());
        let (frame, imu) = (FrameSamples::new(size), ImuWords::default());
        Self { layout, size, clock, frame, imu, notes }
    }

    /// Gives the contents of a block to the sink: its frames, then its samples and events.
    fn decode(
        &mut self,
        block: &[u8],
        sink: &mut RecordingSink<'_>,
    ) -> Result<(), CameraFileError> {
        let size = Some(self.size);
        let mut events = Events::new();
        let mut samples = Vec::new();
        for pair in block.chunks_exact(PAIR_BYTES) {
            let word = |at: usize| {
                pair[at..at + 4].iter().fold(0_u32, |bits, byte| (bits << 8) | u32::from(*byte))
            };
            let (address, t) = (word(0), word(4));
            let t = self.clock.at(t);
            if self.layout == AddressLayout::Davis && address >> 31 == 1 {
                if let Some(content) = self.sample(address, t, &mut samples) {
                    sink(&SourceStream::new("frames", PayloadKind::Frames, size), content)?;
                }
            } else if let Some(event) = self.event(address, t) {
                events.push(event);
            }
        }
        if !samples.is_empty() {
            let stream = SourceStream::new("imu", PayloadKind::Imu, None);
            sink(&stream, Content::Imu(samples))?;
        }
        sink(&SourceStream::only_events(size), Content::Events(events))
    }

    fn event(&mut self, address: u32, t: i64) -> Option<Event> {
        let (x, y, on, is_special) = match self.layout {
            AddressLayout::Davis => {
                let (x, y) = davis_place(address);
                (x, y, address & 0x800 != 0, address & 0x400 != 0)
            }
            AddressLayout::Dvs128 => {
                let (x, y) = ((address >> 1) & 0x7f, (address >> 8) & 0x7f);
                (x, y, address & 1 == 0, address & 0x8000 != 0)
            }
        };
        if is_special {
            self.notes.leave_out("special events", 1);
            return None;
        }
        let (x, y) = self.on_image(x, y);
        Some(Event { t, x, y, on })
    }

    /// Coordinates of images; an address off the chip stays off it.
    fn on_image(&self, x: u32, y: u32) -> (u16, u16) {
        let mirror = |v: u32, side: u16| u32::from(side).checked_sub(v + 1).map_or(v, |v| v) as u16;
        (mirror(x, self.size.width), mirror(y, self.size.height))
    }

    /// Takes a word of a frame or of the inertial unit; gives the frame that it completes.
    fn sample(&mut self, address: u32, t: i64, samples: &mut Vec<ImuSample>) -> Option<Content> {
        if address & 0x800 != 0 {
            let sample = self.imu.take(address, t, &mut self.notes)?;
            samples.push(sample);
            self.notes.decide(
                "inertial samples are in the ranges that jAER sets, 4 g and 500 deg/s; the file \
                 states none"
                    .into(),
            );
            return None;
        }
        let (x, y) = davis_place(address);
        let place = self.on_image(x, y);
        let frame = self.frame.take(place, address, t, &mut self.notes)?;
        self.notes.decide(
            "the 10 bits of the frames are the upper ones of 16, as cAER writes them".into(),
        );
        Some(Content::Frame(frame))
    }

    fn finish(mut self) -> RecordingNotes {
        self.frame.abandon(&mut self.notes);
        self.notes
    }
}

/// Column and row of an address of a DAVIS.
fn davis_place(address: u32) -> (u32, u32) {
    ((address >> 12) & 0x3ff, (address >> 22) & 0x1ff)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraEvents;
    use evrig_core::frame::Samples;

    fn read(header: &str, pairs: &[[u32; 2]], size: Option<Size>) -> Result<CameraEvents, String> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat");
        let words = pairs.iter().flatten().flat_map(|word| word.to_be_bytes());
        let bytes: Vec<u8> = header.bytes().chain(words).collect();
        std::fs::write(&path, bytes).unwrap();
        let found = CameraEvents::gather(&path, None, |sink| super::read(&path, size, sink));
        found.map_err(|error| error.to_string())
    }

    #[test]
    fn davis_addresses_count_from_the_opposite_corner() {
        let address = |x: u32, y: u32, on: u32| (y << 22) | (x << 12) | (on << 11);
        let pairs = [
            [address(345, 259, 1), 10],
            [address(0, 0, 0), u32::MAX],
            [0x400, 5],
            [address(1, 2, 1), 7],
        ];
        let header = "#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346\r\n";
        let found = read(header, &pairs, None).unwrap();
        let rows: Vec<(i64, u16, u16, bool)> =
            found.events.as_slice().iter().map(|e| (e.t, e.x, e.y, e.on)).collect();
        let wrapped = (1 << 32) + 7;
        let expected =
            [(10, 0, 0, true), (u32::MAX.into(), 345, 259, false), (wrapped, 344, 257, true)];
        assert_eq!(rows, expected);
        assert_eq!(found.left_out[0].1, 1);
    }

    #[test]
    fn a_chip_that_is_not_named_is_asked_for() {
        let error = read("#!AER-DAT2.0\r\n", &[[0, 0]], None).unwrap_err();
        assert!(error.contains("--size"), "{error}");
        let found = read("#!AER-DAT2.0\r\n", &[[0x0102, 3]], Some(Size::new(128, 128))).unwrap();
        let event = found.events.as_slice().iter().next().unwrap();
        assert_eq!((event.x, event.y, event.on), (126, 126, true));
    }

    #[test]
    fn a_file_cut_anywhere_is_read_up_to_the_cut() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat");
        let header = "#!AER-DAT2.0\r\n# AEChip: Davis346\r\n";
        let pair = |i: u32| [(i << 22) | (i << 12), 100 * i];
        let words: Vec<u8> = (1..30).flat_map(pair).flat_map(u32::to_be_bytes).collect();
        for end in 0..words.len() {
            std::fs::write(&path, [header.as_bytes(), &words[..end]].concat()).unwrap();
            let cut = CameraEvents::gather(&path, None, |sink| super::read(&path, None, sink));
            let cut = cut.unwrap();
            let expected = (1..).map(|i| 100 * i).take(end / PAIR_BYTES);
            assert!(cut.events.as_slice().t.iter().copied().eq(expected), "{end}");
            let is_stated = cut.damage.is_some_and(|what| what.contains("the file is cut"));
            assert_eq!(is_stated, end % PAIR_BYTES > 0, "{end}");
        }
    }

    #[test]
    fn frames_are_reset_minus_signal_and_inertial_samples_seven_words() {
        let place = |i: u32| ((i / 2) << 22) | ((i % 2) << 12) | (1 << 31);
        let mut pairs: Vec<[u32; 2]> = (0..4).map(|i| [place(i) | (500 + i), 100 + i]).collect();
        pairs.extend((0..4).map(|i| [place(i) | 0x400 | (100 + 10 * i), 300 + i]));
        // A frame of which one pixel is never read.
        pairs.extend((0..3).map(|i| [place(i) | 0x400, 500]));
        let imu = |kind: u32, value: i16| {
            (1 << 31) | (kind << 28) | (u32::from(value as u16) << 12) | 0xc00
        };
        let values = [8192, 0, -8192, 0, 131, 0, -131];
        pairs.extend((0..7).map(|k| [imu(k, values[k as usize]), 700 + k]));
        pairs.push([imu(3, 1), 800]);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat");
        let words = pairs.iter().flatten().flat_map(|word| word.to_be_bytes());
        std::fs::write(&path, "#!AER-DAT2.0\r\n".bytes().chain(words).collect::<Vec<u8>>())
            .unwrap();
        let (mut frames, mut samples) = (Vec::new(), Vec::new());
        let mut sink = |_: &SourceStream, content: Content| {
            match content {
                Content::Frame(frame) => frames.push(frame),
                Content::Imu(found) => samples.extend(found),
                _ => {}
            }
            Ok(())
        };
        let notes = super::read(&path, Some(Size::new(2, 2)), &mut sink).unwrap();
        assert_eq!(frames.len(), 1);
        // Rows and columns count from the opposite corner.
        let expected = [373_u16, 382, 391, 400].map(|difference| difference << 6);
        assert_eq!(frames[0].samples, Samples::U16(expected.to_vec()));
        let exposure = frames[0].timing.exposure.unwrap().map(|stamp| stamp.as_micros());
        assert_eq!(exposure, [103, 300]);
        assert_eq!(samples.len(), 1);
        assert_eq!(samples[0].acceleration_g, [1.0, 0.0, -1.0]);
        assert_eq!(samples[0].rotation_deg_per_s, [2.0, 0.0, -2.0]);
        assert_eq!((samples[0].temperature_c, samples[0].stamp.as_micros()), (35.0, 700));
        let expected = [
            ("words of incomplete inertial samples", 1),
            ("frames without both readings of every pixel", 1),
        ];
        assert_eq!(notes.left_out, expected.map(|(what, n)| (what.to_owned(), n)));
    }
}
