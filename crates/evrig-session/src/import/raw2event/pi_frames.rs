//! The Pi's frames and timestamps, whose format is detected and recorded as decisions.

use super::files::RecordingFiles;
use super::request::ImportRaw2Event;
use crate::import::builder::SessionBuilder;
use crate::manifest::file_name;
use crate::{DataLoss, SessionError, StreamEntry, StreamKind};
use evrig_core::time::{Clock, PiSensor};
use evrig_format::npy::ArrayWriter;
use evrig_format::raw2event::{
    MetadataRecord, RawJustification, SensorUnit, parse_metadata, raw_justification, sensor_unit,
};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// What was taken from the Pi's files.
#[derive(Debug, Default)]
pub(super) struct ImportedPiFrames {
    pub(super) streams: Vec<StreamEntry>,
    pub(super) files: Vec<PathBuf>,
    pub(super) losses: Vec<DataLoss>,
    pub(super) decisions: Vec<String>,
}

impl ImportedPiFrames {
    pub(super) fn read(
        request: &ImportRaw2Event<'_>,
        files: &RecordingFiles,
        builder: &SessionBuilder,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Self, SessionError> {
        let directory = builder.layout.frames();
        builder.make_directory(&directory)?;
        let mut pi = Self::default();
        let records = pi.stamps(&files.metadata, request)?;
        let streams = [("raw", &files.raw, 2), ("rgb", &files.rgb, 4)];
        for (name, file, bytes_a_pixel) in streams {
            let Some(file) = file else {
                pi.decisions
                    .push(format!("there is no {name}_frames file; the stream is left out"));
                continue;
            };
            let frame_bytes = request.size.n_pixels() * bytes_a_pixel;
            let n = pi.count(name, file, frame_bytes, records.len())?;
            let path = directory.join(format!("{name}.npy"));
            if name == "raw" {
                pi.copy_raw(file, &path, request, n, progress)?;
            } else {
                copy_rgb(file, &path, request, n, progress)?;
            }
            let first_and_last = (n > 0).then(|| (records[0].0, records[n as usize - 1].0));
            pi.streams.push(StreamEntry {
                name: name.into(),
                kind: StreamKind::Frames,
                file: format!("frames/{name}.npy"),
                stream_id: None,
                size: Some(request.size),
                count: n,
                first_us: first_and_last.map(|(first, _)| first.div_euclid(1_000)),
                last_us: first_and_last.map(|(_, last)| last.div_euclid(1_000)),
                clock: PiSensor::NAME.into(),
                source: format!("Raspberry Pi camera, imported from {}", file_name(file)),
            });
            pi.files.push(path);
        }
        if files.raw.is_some() && files.rgb.is_some() {
            pi.decisions.push(
                "known defect of the layout: each RGB frame comes from the request after its raw frame and \
                 shares its stamp, so it is at least one frame late, and raw ran at half the camera's rate"
                    .into(),
            );
        }
        pi.write_stamps(&directory, &records)?;
        Ok(pi)
    }

    /// SensorTimestamp (ns) and RealTime (Unix µs) of each frame.
    fn stamps(
        &mut self,
        path: &Path,
        request: &ImportRaw2Event<'_>,
    ) -> Result<Vec<(i64, Option<i64>)>, SessionError> {
        let bytes = std::fs::read(path).map_err(SessionError::io(path))?;
        let (mut records, n_left) = parse_metadata(&bytes, request.zone);
        if n_left > 0 {
            self.lose(
                "metadata",
                1,
                format!("a last partial record of {n_left} bytes was left out"),
            );
        }
        let n_unfilled = records.iter().rev().take_while(|r| r.is_unfilled()).count();
        records.truncate(records.len() - n_unfilled);
        if n_unfilled > 0 {
            self.lose("metadata", n_unfilled as u64, "records at the end were never filled".into());
        }
        if let Some(bad) = records.iter().position(|r| !r.sensor.is_finite()) {
            let what = format!("record {bad}: SensorTimestamp is {}", records[bad].sensor);
            return Err(SessionError::import(path, what));
        }
        let unit = sensor_unit(&records).ok_or_else(|| {
            let what = "the SensorTimestamps are neither ns nor us: no typical interval of 1 ms to 1 s between frames";
            SessionError::import(path, what)
        })?;
        self.decisions.push(match unit {
            SensorUnit::Nanoseconds => "SensorTimestamp is in ns since boot".into(),
            SensorUnit::Microseconds => "SensorTimestamp is in us since the first frame".into(),
        });
        self.decisions.push(format!("RealTime is read as local time in {}", request.zone));
        let to_ns = if unit == SensorUnit::Nanoseconds { 1.0 } else { 1_000.0 };
        self.doubt(&records, to_ns);
        let stamps = records.iter().map(|r| ((r.sensor * to_ns).round() as i64, r.real_time_us));
        Ok(stamps.collect())
    }

    /// Counts what is doubtful in the stamps: duplicates, gaps, jumps of the wall clock, unreadable
    /// times.
    fn doubt(&mut self, records: &[MetadataRecord], to_ns: f64) {
        let mut steps: Vec<f64> =
            records.windows(2).map(|p| (p[1].sensor - p[0].sensor) * to_ns).collect();
        let n_not_later = steps.iter().filter(|step| **step <= 0.0).count() as u64;
        // Repeated stamps say nothing of the camera's rhythm; frames are sought between stamps that
        // ascend, and repetitions fill them.
        steps.retain(|step| *step > 0.0);
        let mut sorted = steps.clone();
        sorted.sort_by(f64::total_cmp);
        let n_repeated = n_not_later as f64;
        let n_missing = match sorted.get(sorted.len() / 2) {
            Some(&typical) => {
                let gaps = steps.iter().filter(|step| **step > 1.5 * typical);
                gaps.map(|step| (step / typical).round() - 1.0).sum::<f64>()
            }
            None => 0.0,
        };
        let n_missing = (n_missing - n_repeated).max(0.0);
        let real: Vec<i64> = records.iter().filter_map(|r| r.real_time_us).collect();
        let n_unreadable = (records.len() - real.len()) as u64;
        let jumps = real.windows(2).filter(|p| p[1] < p[0] || p[1] - p[0] > 1_000_000);
        let counted = [
            (n_not_later, "frames whose SensorTimestamp is not later than the one before"),
            (n_missing as u64, "frames missing between others, by their SensorTimestamps"),
            (jumps.count() as u64, "places where RealTime goes back or jumps by more than 1 s"),
            (n_unreadable, "records whose RealTime is no time"),
        ];
        for (count, what) in counted {
            if count > 0 {
                self.lose("metadata", count, what.into());
            }
        }
    }

    /// How many frames are whole and have a stamp.
    fn count(
        &mut self,
        name: &str,
        path: &Path,
        frame_bytes: usize,
        n_stamps: usize,
    ) -> Result<u64, SessionError> {
        let n_bytes = std::fs::metadata(path).map_err(SessionError::io(path))?.len();
        check_rows(path, n_bytes, frame_bytes, n_stamps)?;
        let n_frames = n_bytes / frame_bytes as u64;
        let n_left = n_bytes % frame_bytes as u64;
        if n_frames == 0 {
            let what =
                format!("{n_bytes} bytes hold no frame of {frame_bytes}; give the frames' --size");
            return Err(SessionError::import(path, what));
        }
        if n_left > 0 {
            self.lose(name, 1, format!("a last partial frame of {n_left} bytes was left out"));
        }
        let n = n_frames.min(n_stamps as u64);
        if n_frames > n {
            self.lose(name, n_frames - n, "frames without a metadata record were left out".into());
        }
        if (n_stamps as u64) > n_frames {
            self.lose(name, n_stamps as u64 - n_frames, "metadata records have no frame".into());
        }
        Ok(n)
    }

    fn copy_raw(
        &mut self,
        from: &Path,
        to: &Path,
        request: &ImportRaw2Event<'_>,
        n: u64,
        progress: &mut dyn FnMut(u64),
    ) -> Result<(), SessionError> {
        let mut frames = FrameFile::open(from, request.size.n_pixels() * 2)?;
        let shape = [n, request.size.height.into(), request.size.width.into()];
        let mut writer = ArrayWriter::<u16>::create(to, &shape)?;
        let mut justification = None;
        for k in 0..n {
            let bytes = frames.next(k)?;
            progress(bytes.len() as u64);
            let words = bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
            let mut samples: Vec<u16> = words.collect();
            let found = raw_justification(&samples).ok_or_else(|| {
                let what =
                    format!("frame {k} is no 10-bit raw frame; is --size {} right?", request.size);
                SessionError::import(from, what)
            })?;
            // A black frame fits `Right` for every camera; the first bright one decides.
            if found == RawJustification::Left && justification.is_none() {
                justification = Some(found);
                if k > 0 {
                    let what = format!("frame {k} is left-justified, frames before it are not");
                    return Err(SessionError::import(from, what));
                }
            }
            if justification == Some(RawJustification::Left) {
                samples.iter_mut().for_each(|sample| *sample >>= 6);
            }
            writer.extend(&samples)?;
        }
        self.decisions.push(match justification {
            Some(_) => {
                "raw samples are left-justified (a Pi 5); they are stored as 0..=1023".into()
            }
            None => "raw samples are right-justified 10 bit (a Pi 4)".into(),
        });
        self.decisions.push("raw frames are Bayer RGGB with the black level in them".into());
        Ok(writer.finish()?)
    }

    fn write_stamps(
        &mut self,
        directory: &Path,
        stamps: &[(i64, Option<i64>)],
    ) -> Result<(), SessionError> {
        let n = stamps.len() as u64;
        let sensor_path = directory.join("sensor_timestamp_ns.npy");
        let mut sensor = ArrayWriter::<i64>::create(&sensor_path, &[n])?;
        sensor.extend(&stamps.iter().map(|(ns, _)| *ns).collect::<Vec<_>>())?;
        sensor.finish()?;
        let real_path = directory.join("real_time_us.npy");
        let mut real = ArrayWriter::<i64>::create(&real_path, &[n])?;
        // Zero marks a time that could not be read: no recording is from 1970.
        real.extend(&stamps.iter().map(|(_, us)| us.unwrap_or(0)).collect::<Vec<_>>())?;
        real.finish()?;
        self.files.extend([sensor_path, real_path]);
        Ok(())
    }

    fn lose(&mut self, stream: &str, count: u64, what: String) {
        self.losses.push(DataLoss { stream: stream.into(), what, count });
    }
}

/// Refuses a file whose bytes per record fit rows of another length: padded, or packed samples.
fn check_rows(
    path: &Path,
    n_bytes: u64,
    frame_bytes: usize,
    n_stamps: usize,
) -> Result<(), SessionError> {
    let per_frame = n_bytes as f64 / (n_stamps as f64).max(1.0);
    let ratio = per_frame / frame_bytes as f64;
    // A few frames more or fewer than records are counted as losses.
    if n_stamps < 2 || (0.9..1.1).contains(&ratio) || n_bytes < frame_bytes as u64 {
        return Ok(());
    }
    // Rows are padded to at most 64 bytes or a power of two; packed samples are 10 or 12 of 16 bits.
    let is_whole = n_bytes.is_multiple_of(n_stamps as u64);
    let thought = match ratio {
        _ if !is_whole => return Ok(()),
        ratio if ratio > 1.0 => "rows may be padded, or --size is not that of the frames",
        ratio if (0.6..0.65).contains(&ratio) => "samples may be packed, 10 bits each",
        ratio if (0.74..0.8).contains(&ratio) => "samples may be packed, 12 bits each",
        _ => return Ok(()),
    };
    Err(SessionError::import(
        path,
        format!(
            "has {per_frame:.0} bytes for each of {n_stamps} metadata records; expected {frame_bytes} \
             per frame: {thought}; give the frames' --size, or store them unpacked and without \
             padding"
        ),
    ))
}

/// RGB frames are stored as they are: R, G, B and one unused sample per pixel.
fn copy_rgb(
    from: &Path,
    to: &Path,
    request: &ImportRaw2Event<'_>,
    n: u64,
    progress: &mut dyn FnMut(u64),
) -> Result<(), SessionError> {
    let mut frames = FrameFile::open(from, request.size.n_pixels() * 4)?;
    let shape = [n, request.size.height.into(), request.size.width.into(), 4];
    let mut writer = ArrayWriter::<u8>::create(to, &shape)?;
    for k in 0..n {
        let bytes = frames.next(k)?;
        progress(bytes.len() as u64);
        writer.extend(bytes)?;
    }
    Ok(writer.finish()?)
}

/// FrameFile of equal length, one after another.
struct FrameFile {
    path: PathBuf,
    reader: BufReader<File>,
    frame: Vec<u8>,
}

impl FrameFile {
    fn open(path: &Path, frame_bytes: usize) -> Result<Self, SessionError> {
        let file = File::open(path).map_err(SessionError::io(path))?;
        Ok(Self {
            path: path.to_owned(),
            reader: BufReader::new(file),
            frame: vec![0; frame_bytes],
        })
    }

    fn next(&mut self, k: u64) -> Result<&[u8], SessionError> {
        self.reader.read_exact(&mut self.frame).map_err(|e| {
            SessionError::import(&self.path, format!("frame {k} cannot be read: {e}"))
        })?;
        Ok(&self.frame)
    }
}
