//! Streams of a session as NumPy arrays.

use evrig_core::event::EventSlice;
use evrig_core::frame::Samples;
use evrig_core::imu::{ImuSample, Trigger};
use evrig_core::time::{Clock, PiSensor};
use evrig_format::aedat4::{Content, Reader};
use evrig_format::hdf5::SideGroup;
use evrig_format::npy::{ArrayReader, Column, NpzWriter};
use evrig_session::{Session, SessionError, StreamEntry, StreamKind};
use serde::Serialize;
use std::path::Path;

/// An array that was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ExportedArray {
    /// Its name in the archive.
    pub name: String,
    /// Its length along each axis.
    pub shape: Vec<u64>,
}

/// Writes a recorded stream of frames, inertial samples or triggers into an npz archive.
///
/// | stream | arrays |
/// | --- | --- |
/// | frames | `frames` (N, H, W) or (N, H, W, C); `t_us`; of AEDAT4 frames also `exposure_start_us`, `exposure_end_us`;
///            of the Pi's, instead of `t_us`, `sensor_timestamp_ns` and `real_time_us` (0 where unreadable) |
/// | imu | `t_us`; `acceleration_g` (N, 3), `rotation_deg_per_s`, `magnetic_ut`; `temperature_c` |
/// | triggers | `t_us`; `kind`, the code of AEDAT4's trigger types |
///
/// None for streams of another kind.
pub(super) fn recorded(
    session: &Session,
    entry: &StreamEntry,
    out: &Path,
) -> Result<Option<Vec<ExportedArray>>, SessionError> {
    match entry.kind {
        StreamKind::Frames => frames(session, entry, out).map(Some),
        StreamKind::Imu => imu(session, entry, out).map(Some),
        StreamKind::Triggers => triggers(session, entry, out).map(Some),
        _ => Ok(None),
    }
}

/// Writes events: `events`, int64 (N, 4) with the columns t_us, x, y and p, 1 for On, as the paper's
/// authors publish theirs; beside them each group of columns as `<stream>_<column>`.
pub(super) fn events(
    events: EventSlice<'_>,
    images: &[SideGroup],
    out: &Path,
) -> Result<Vec<ExportedArray>, SessionError> {
    let mut archive = Archive::create(out)?;
    let rows =
        events.iter().flat_map(|event| [event.t, event.x.into(), event.y.into(), event.on.into()]);
    archive.add::<i64>("events", &[events.len() as u64, 4], rows)?;
    for group in images {
        for column in &group.columns {
            let name = format!("{}_{}", group.name, column.name);
            match &column.values {
                Column::Short(values) => {
                    archive.add(&name, &column.shape(), values.iter().copied())?;
                }
                Column::Int(values) => {
                    archive.add(&name, &column.shape(), values.iter().copied())?;
                }
                Column::Float(values) => {
                    archive.add(&name, &column.shape(), values.iter().copied())?;
                }
            }
        }
    }
    archive.finish()
}

/// One archive under construction, with the list of what is in it.
pub(super) struct Archive {
    npz: NpzWriter<std::io::BufWriter<std::fs::File>>,
    arrays: Vec<ExportedArray>,
}

impl Archive {
    pub(super) fn create(out: &Path) -> Result<Self, SessionError> {
        Ok(Self { npz: NpzWriter::create(out)?, arrays: Vec::new() })
    }

    pub(super) fn add<T: evrig_format::npy::Element>(
        &mut self,
        name: &str,
        shape: &[u64],
        elements: impl IntoIterator<Item = T>,
    ) -> Result<(), SessionError> {
        self.npz.add(name, shape, elements)?;
        self.arrays.push(ExportedArray { name: name.to_owned(), shape: shape.to_vec() });
        Ok(())
    }

    pub(super) fn finish(self) -> Result<Vec<ExportedArray>, SessionError> {
        self.npz.finish()?;
        Ok(self.arrays)
    }
}

/// The contents of one stream of an AEDAT4 file, up to the damage if it is damaged.
fn contents(
    session: &Session,
    entry: &StreamEntry,
) -> Result<impl Iterator<Item = Content>, SessionError> {
    let id = entry.stream_id;
    let reader = Reader::open(&session.layout().inside(&entry.file)?)?;
    let of_stream = move |packet: evrig_format::aedat4::Packet| {
        id.is_none_or(|id| id == packet.stream).then_some(packet.content)
    };
    Ok(reader.map_while(Result::ok).filter_map(of_stream))
}

fn frames(
    session: &Session,
    entry: &StreamEntry,
    out: &Path,
) -> Result<Vec<ExportedArray>, SessionError> {
    if entry.file.ends_with(".npy") {
        return imported_frames(session, entry, out);
    }
    let changed = |what: String| SessionError::import(&session.root().join(&entry.file), what);
    let mut times = Vec::new();
    let mut exposures = Vec::new();
    let mut form = None;
    let (mut bytes, mut words) = (Vec::new(), Vec::new());
    for content in contents(session, entry)? {
        let Content::Frame(frame) = content else { continue };
        let this = (frame.size, frame.channels, frame.samples.bits());
        if *form.get_or_insert(this) != this {
            let what = format!("frame {} changes size or depth; export it as AEDAT4", times.len());
            return Err(changed(what));
        }
        times.push(frame.timing.stamp.as_micros());
        let exposure = frame.timing.exposure.unwrap_or([frame.timing.stamp; 2]);
        exposures.push(exposure.map(|stamp| stamp.as_micros()));
        match frame.samples {
            Samples::U8(samples) => bytes.extend(samples),
            Samples::U16(samples) => words.extend(samples),
        }
    }
    let n = times.len() as u64;
    let mut archive = Archive::create(out)?;
    if let Some((size, channels, bits)) = form {
        let mut shape = vec![n, size.height.into(), size.width.into()];
        if channels.count() > 1 {
            shape.push(channels.count() as u64);
        }
        if bits == 8 {
            archive.add("frames", &shape, bytes)?;
        } else {
            archive.add("frames", &shape, words)?;
        }
    }
    archive.add("t_us", &[n], times)?;
    archive.add("exposure_start_us", &[n], exposures.iter().map(|exposure| exposure[0]))?;
    archive.add("exposure_end_us", &[n], exposures.iter().map(|exposure| exposure[1]))?;
    archive.finish()
}

/// Imported frames are written one by one: there may be more of them than memory.
fn imported_frames(
    session: &Session,
    entry: &StreamEntry,
    out: &Path,
) -> Result<Vec<ExportedArray>, SessionError> {
    let path = session.layout().inside(&entry.file)?;
    let mut reader = ArrayReader::open(&path)?;
    let shape = reader.shape().to_vec();
    let n_frames = shape.first().copied().unwrap_or(0);
    let n = shape.iter().skip(1).product::<u64>() as usize;
    let mut archive = Archive::create(out)?;
    let mut failure = None;
    let added = if reader.unsigned_bytes() == Some(1) {
        let frames =
            (0..n_frames).map_while(|_| reader.next_u8(n).map_err(|e| failure = Some(e)).ok());
        archive.add("frames", &shape, frames.flatten())
    } else {
        let frames =
            (0..n_frames).map_while(|_| reader.next_u16(n).map_err(|e| failure = Some(e)).ok());
        archive.add("frames", &shape, frames.flatten())
    };
    if let Some(error) = failure {
        return Err(error.into());
    }
    added?;
    // The Pi's frames have the stamps of its sensor and of its wall clock, all others one time.
    let columns: &[_] = if entry.clock == PiSensor::NAME {
        &["sensor_timestamp_ns", "real_time_us"]
    } else {
        &["timestamps_us"]
    };
    for &column in columns {
        let times = ArrayReader::open(&path.with_file_name(format!("{column}.npy")))?.read_all()?;
        let times = times.fields.into_iter().next().and_then(|(_, t)| t.into_integers().ok());
        let mut times = times.unwrap_or_default();
        times.truncate(n_frames as usize);
        let name = if column == "timestamps_us" { "t_us" } else { column };
        archive.add(name, &[times.len() as u64], times)?;
    }
    archive.finish()
}

fn imu(
    session: &Session,
    entry: &StreamEntry,
    out: &Path,
) -> Result<Vec<ExportedArray>, SessionError> {
    let runs = contents(session, entry)?.filter_map(|content| match content {
        Content::Imu(samples) => Some(samples),
        _ => None,
    });
    let samples: Vec<ImuSample> = runs.flatten().collect();
    let n = samples.len() as u64;
    let mut archive = Archive::create(out)?;
    archive.add("t_us", &[n], samples.iter().map(|s| s.stamp.as_micros()))?;
    archive.add("acceleration_g", &[n, 3], samples.iter().flat_map(|s| s.acceleration_g))?;
    archive.add(
        "rotation_deg_per_s",
        &[n, 3],
        samples.iter().flat_map(|s| s.rotation_deg_per_s),
    )?;
    archive.add("magnetic_ut", &[n, 3], samples.iter().flat_map(|s| s.magnetic_ut))?;
    archive.add("temperature_c", &[n], samples.iter().map(|s| s.temperature_c))?;
    archive.finish()
}

fn triggers(
    session: &Session,
    entry: &StreamEntry,
    out: &Path,
) -> Result<Vec<ExportedArray>, SessionError> {
    let runs = contents(session, entry)?.filter_map(|content| match content {
        Content::Triggers(edges) => Some(edges),
        _ => None,
    });
    let edges: Vec<Trigger> = runs.flatten().collect();
    let n = edges.len() as u64;
    let mut archive = Archive::create(out)?;
    archive.add("t_us", &[n], edges.iter().map(|edge| edge.stamp.as_micros()))?;
    archive.add("kind", &[n], edges.iter().map(|edge| i16::from(edge.kind.code())))?;
    archive.finish()
}
