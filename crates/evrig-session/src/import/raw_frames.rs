//! Frames in a file without a description: rows may be padded, and samples packed to 10 or 12 bits.
//!
//! The file's length must be a whole number of frames. Of the layouts that cameras write, those that
//! give the stated number of frames are considered; where several do, none is assumed.

use super::event_table::TimeUnit;
use super::frame_times::{self, DecidedTimes, FrameTimes};
use crate::SessionError;
use evrig_core::geometry::Size;
use evrig_format::npy::ArrayWriter;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::str::FromStr;

/// Endings of files of frames without a description.
pub(super) const RAW_ENDINGS: [&str; 2] = ["raw", "bin"];

/// Multiples of bytes to which cameras pad a row: libcamera (Raspberry Pi 32 and 64), V4L2 (16),
/// Windows bitmaps (4), DMA pages of some frame grabbers (128, 256).
const ROW_ALIGNMENTS: [u64; 7] = [1, 4, 16, 32, 64, 128, 256];

/// What the user states about frames without a description.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RawFrameOptions {
    /// Columns and rows.
    pub size: Option<Size>,
    /// Bytes of a row with its padding.
    pub stride: Option<u32>,
    /// How samples are stored.
    pub packing: Option<SamplePacking>,
}

/// How samples are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SamplePacking {
    /// A byte each.
    Bits8,
    /// Four samples of 10 bits in five bytes (MIPI CSI-2, RAW10).
    Raw10,
    /// Two samples of 12 bits in three bytes (MIPI CSI-2, RAW12).
    Raw12,
    /// Two bytes each, little-endian.
    Bits16,
}

const PACKINGS: [SamplePacking; 4] =
    [SamplePacking::Bits8, SamplePacking::Raw10, SamplePacking::Raw12, SamplePacking::Bits16];

impl SamplePacking {
    const fn name(self) -> &'static str {
        match self {
            Self::Bits8 => "8",
            Self::Raw10 => "raw10",
            Self::Raw12 => "raw12",
            Self::Bits16 => "16",
        }
    }

    /// Bytes of a row without padding; none where the packing does not divide it.
    const fn row_bytes(self, width: u64) -> Option<u64> {
        match self {
            Self::Bits8 => Some(width),
            Self::Raw10 if width.is_multiple_of(4) => Some(width / 4 * 5),
            Self::Raw12 if width.is_multiple_of(2) => Some(width / 2 * 3),
            Self::Raw10 | Self::Raw12 => None,
            Self::Bits16 => Some(width * 2),
        }
    }

    /// Appends the samples of a row.
    fn unpack(self, row: &[u8], samples: &mut Vec<u16>) {
        match self {
            Self::Bits8 => samples.extend(row.iter().map(|byte| u16::from(*byte))),
            Self::Raw10 => {
                for group in row.chunks_exact(5) {
                    let low = |i: usize| u16::from(group[4] >> (2 * i)) & 3;
                    samples.extend((0..4).map(|i| (u16::from(group[i]) << 2) | low(i)));
                }
            }
            Self::Raw12 => {
                for group in row.chunks_exact(3) {
                    let low = |i: usize| u16::from(group[2] >> (4 * i)) & 0xf;
                    samples.extend((0..2).map(|i| (u16::from(group[i]) << 4) | low(i)));
                }
            }
            Self::Bits16 => {
                let pairs = row.chunks_exact(2);
                samples.extend(pairs.map(|pair| u16::from_le_bytes([pair[0], pair[1]])));
            }
        }
    }
}

impl fmt::Display for SamplePacking {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SamplePacking {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let found = PACKINGS.into_iter().find(|packing| packing.name() == text);
        found.ok_or_else(|| "expected 8, raw10, raw12 or 16".into())
    }
}

/// A layout under which the file is a whole number of frames.
struct FrameLayout {
    packing: SamplePacking,
    row_bytes: u64,
    stride: u64,
    n: u64,
    times: DecidedTimes,
}

/// A file of frames, and what is stated about it.
pub(super) struct RawFrameFile<'a> {
    pub(super) path: &'a Path,
    pub(super) options: RawFrameOptions,
    pub(super) times: &'a FrameTimes,
    pub(super) time_unit: Option<TimeUnit>,
}

/// Frames that were written as an array.
pub(super) struct RawArray {
    pub(super) size: Size,
    pub(super) times: DecidedTimes,
    pub(super) bits: u8,
}

/// Writes the frames of a file into an array.
pub(super) fn write_array(given: &RawFrameFile<'_>, path: &Path) -> Result<RawArray, SessionError> {
    let wrong = |what: String| SessionError::import(given.path, what);
    let Some(size) = given.options.size else {
        let what = "holds frames without a description: give their --size, and --packing (8, raw10, \
                    raw12 or 16) and --stride (bytes of a row) where several fit";
        return Err(wrong(what.into()));
    };
    let io = SessionError::io;
    let n_bytes = std::fs::metadata(given.path).map_err(io(given.path))?.len();
    let mut layout = choose(given, size, n_bytes)?;
    let FrameLayout { packing, row_bytes, stride, n, .. } = layout;
    layout.times.decisions.push(format!(
        "frames of {size} pixels, packing {packing}, rows of {stride} bytes: {n} frames are the \
         {n_bytes} bytes of the file; a colour sensor's mosaic is kept as it is"
    ));
    let file = File::open(given.path).map_err(io(given.path))?;
    let mut reader = BufReader::with_capacity(1 << 20, file);
    let shape = [n, size.height.into(), size.width.into()];
    let mut row = vec![0; stride as usize];
    let mut samples = Vec::with_capacity(size.n_pixels());
    let mut narrow = match packing {
        SamplePacking::Bits8 => Some(ArrayWriter::<u8>::create(path, &shape)?),
        _ => None,
    };
    let mut wide = match packing {
        SamplePacking::Bits8 => None,
        _ => Some(ArrayWriter::<u16>::create(path, &shape)?),
    };
    for _ in 0..n {
        samples.clear();
        for _ in 0..size.height {
            reader.read_exact(&mut row).map_err(io(given.path))?;
            packing.unpack(&row[..row_bytes as usize], &mut samples);
        }
        if let Some(writer) = &mut wide {
            writer.extend(&samples)?;
        } else if let Some(writer) = &mut narrow {
            writer.extend(&samples.iter().map(|sample| *sample as u8).collect::<Vec<_>>())?;
        }
    }
    narrow.map_or(Ok(()), ArrayWriter::finish)?;
    wide.map_or(Ok(()), ArrayWriter::finish)?;
    let bits = if packing == SamplePacking::Bits8 { 8 } else { 16 };
    Ok(RawArray { size, times: layout.times, bits })
}

/// The only layout that fits the length of the file, the options and the times.
fn choose(given: &RawFrameFile<'_>, size: Size, n_bytes: u64) -> Result<FrameLayout, SessionError> {
    let wrong = |what: String| SessionError::import(given.path, what);
    let mut fitting: Vec<FrameLayout> = Vec::new();
    let mut times_error = None;
    let wanted = given.options.packing;
    for packing in PACKINGS.into_iter().filter(|packing| wanted.is_none_or(|p| p == *packing)) {
        let Some(row_bytes) = packing.row_bytes(size.width.into()) else { continue };
        let mut strides: Vec<u64> = match given.options.stride {
            Some(stride) => vec![stride.into()],
            None => ROW_ALIGNMENTS.map(|to| row_bytes.next_multiple_of(to)).to_vec(),
        };
        strides.dedup();
        for stride in strides.into_iter().filter(|stride| *stride >= row_bytes) {
            let frame_bytes = stride * u64::from(size.height);
            if n_bytes == 0 || !n_bytes.is_multiple_of(frame_bytes) {
                continue;
            }
            let n = n_bytes / frame_bytes;
            match frame_times::decide(given.times, given.time_unit, n, &[]) {
                Ok(times) => {
                    fitting.push(FrameLayout { packing, row_bytes, stride, n, times });
                }
                Err(error) => times_error = Some(error),
            }
        }
    }
    match fitting.len() {
        1 => fitting.pop().ok_or_else(|| wrong("fits no layout".into())),
        0 => Err(times_error.unwrap_or_else(|| {
            wrong(format!(
                "has {n_bytes} bytes, no whole number of frames of {size} pixels in a known packing \
                 (8, raw10, raw12, 16) and padding; check --size, give --stride, or unpack it into an \
                 npy array of N x H x W, uint16"
            ))
        })),
        _ => {
            let fits = fitting.iter().map(|fit| {
                format!("{} frames (--packing {} --stride {})", fit.n, fit.packing, fit.stride)
            });
            let fits: Vec<String> = fits.collect();
            let what = format!(
                "has {n_bytes} bytes, which are {}; choose with these options, or give --timestamps, \
                 which counts the frames",
                fits.join(" or ")
            );
            Err(wrong(what))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{EventTableOptions, ImportFrames, import_frames};
    use crate::{Manifest, StreamName};
    use evrig_format::npy::ArrayReader;

    fn import(
        bytes: &[u8],
        n_times: Option<usize>,
        raw: RawFrameOptions,
    ) -> Result<(Vec<u64>, Vec<i64>, Manifest), String> {
        let directory = tempfile::tempdir().unwrap();
        let (file, times) = (directory.path().join("a.raw"), directory.path().join("t.csv"));
        std::fs::write(&file, bytes).unwrap();
        let lines: Vec<String> =
            (0..n_times.unwrap_or(0)).map(|i| (i * 10_000).to_string()).collect();
        std::fs::write(&times, format!("t_us\n{}\n", lines.join("\n"))).unwrap();
        let request = ImportFrames {
            frames: &file,
            times: n_times.map_or(FrameTimes::Fps(100.0), |_| FrameTimes::File(times)),
            frame_time_unit: None,
            events: None,
            events_name: StreamName::new("real").unwrap(),
            options: EventTableOptions::default(),
            raw,
        };
        let root = directory.path().join("session");
        let manifest = import_frames(&request, &root).map_err(|error| error.to_string())?;
        let mut reader = ArrayReader::open(&root.join("frames/frames.npy")).unwrap();
        let shape = reader.shape().to_vec();
        let n = shape.iter().product::<u64>() as usize;
        let values = match reader.unsigned_bytes() {
            Some(1) => reader.next_u8(n).unwrap().into_iter().map(i64::from).collect(),
            _ => reader.next_u16(n).unwrap().into_iter().map(i64::from).collect(),
        };
        Ok((shape, values, manifest))
    }

    /// Two frames of 8 x 3 samples of 10 or 12 bits as CSI-2 packs them, rows padded to 32 bytes.
    fn packed(bits: u32) -> (Vec<u8>, Vec<i64>) {
        let values: Vec<i64> = (0..48).map(|i| (i * 83 + 5) % (1 << bits)).collect();
        let mut bytes = Vec::new();
        for row in values.chunks(8) {
            let start = bytes.len();
            let n_group = if bits == 10 { 4 } else { 2 };
            for group in row.chunks(n_group) {
                bytes.extend(group.iter().map(|v| (v >> (bits - 8)) as u8));
                let low = |(i, v): (usize, &i64)| {
                    (v & ((1 << (bits - 8)) - 1)) << (i as u32 * (bits - 8))
                };
                bytes.push(group.iter().enumerate().map(low).sum::<i64>() as u8);
            }
            bytes.resize(start + 32, 0xee);
        }
        (bytes, values)
    }

    #[test]
    fn packed_samples_in_padded_rows_come_out_as_they_were() {
        let size = Some(Size::new(8, 3));
        for (bits, packing) in [(10, SamplePacking::Raw10), (12, SamplePacking::Raw12)] {
            let (bytes, values) = packed(bits);
            let raw = RawFrameOptions { size, packing: Some(packing), stride: Some(32) };
            let (shape, found, manifest) = import(&bytes, None, raw).unwrap();
            assert_eq!((shape, found), (vec![2, 3, 8], values));
            assert!(manifest.decisions.iter().any(|d| d.contains("rows of 32 bytes")));
        }
    }

    #[test]
    fn the_number_of_times_decides_and_without_it_what_fits_is_listed() {
        let size = Size::new(8, 3);
        let raw = RawFrameOptions { size: Some(size), ..Default::default() };
        // 16 bits: one frame of 48 bytes; of 8 bits it would be two.
        let bytes: Vec<u8> = (0..24_u16).flat_map(|i| (i * 40).to_le_bytes()).collect();
        let error = import(&bytes, None, raw).unwrap_err();
        for part in ["2 frames (--packing 8 --stride 8)", "1 frames (--packing 16 --stride 16)"] {
            assert!(error.contains(part), "{error}");
        }
        let raw16 = RawFrameOptions { packing: Some(SamplePacking::Bits16), ..raw };
        let (shape, values, _) = import(&bytes, None, raw16).unwrap();
        assert_eq!((shape[0], values[23]), (1, 920));
        // 8 bits, rows padded from 10 to 12 bytes: with four frames nothing else fits.
        let raw = RawFrameOptions { size: Some(Size::new(10, 3)), ..raw };
        let padded: Vec<u8> =
            (0..12).flat_map(|row| [[row; 10].as_slice(), &[9; 2]].concat()).collect();
        let (shape, values, _) = import(&padded, Some(4), raw).unwrap();
        assert_eq!((shape, values[119]), (vec![4, 3, 10], 11));
        let error = import(&padded[..100], None, raw).unwrap_err();
        assert!(error.contains("no whole number of frames"), "{error}");
        let error = import(&padded, None, RawFrameOptions::default()).unwrap_err();
        assert!(error.contains("--size"), "{error}");
    }
}
