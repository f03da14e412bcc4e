//! ImportedFrames from an array or a folder, with events of the same grid if there are any.

use super::builder::SessionBuilder;
use super::{event_table, images};
use crate::manifest::file_name;
use crate::{
    DataLoss, Journal, Manifest, Origin, SessionError, SessionStatus, StreamEntry, StreamKind,
    StreamName,
};
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Davis};
use evrig_format::aedat4::{Compression, StreamSpec, Writer};
use evrig_format::npy::{ArrayReader, ArrayWriter, Element};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Where the frames' times come from.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameTimes {
    /// Equal steps from zero, frames per second.
    Fps(f64),
    /// A file of one time in µs a frame: npy, or text with one number a line.
    File(PathBuf),
}

/// What to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportFrames<'a> {
    /// An npy array of N x H x W, u8 or u16, or a folder of images.
    pub frames: &'a Path,
    /// When each frame was.
    pub times: FrameTimes,
    /// Events of the same pixel grid and clock.
    pub events: Option<&'a Path>,
    /// The events' stream name: `real`, or any other for events simulated elsewhere.
    pub events_name: StreamName,
}

/// The frames' stream once its array is written.
struct ImportedFrames {
    size: Size,
    times: Vec<i64>,
    bits: u8,
}

/// Makes a session of frames and, if given, events.
///
/// # Errors
/// When a file is not what it should be, the times do not ascend or are not as many as the
/// frames, `root` is taken, or writing fails.
pub fn import_frames(request: &ImportFrames<'_>, root: &Path) -> Result<Manifest, SessionError> {
    if !request.frames.exists() {
        return Err(SessionError::import(request.frames, "there is no such file or folder"));
    }
    let builder = SessionBuilder::take(root)?;
    let directory = builder.layout.frames();
    builder.make_directory(&directory)?;
    let path = directory.join("frames.npy");
    let frames = if request.frames.is_dir() {
        from_folder(request, &path)?
    } else {
        from_array(request, &path)?
    };
    let times_path = directory.join("timestamps_us.npy");
    let mut times = ArrayWriter::create(&times_path, &[frames.times.len() as u64])?;
    times.extend(&frames.times)?;
    times.finish()?;

    let mut streams = vec![frames_entry(&frames)];
    let mut files = vec![builder.file_entry(&path)?, builder.file_entry(&times_path)?];
    let mut losses = Vec::new();
    if let Some(events) = request.events {
        let (entry, events_path, lost) = take_events(&builder, request, events, frames.size)?;
        files.push(builder.file_entry(&events_path)?);
        streams.push(entry);
        losses = lost;
    }
    let origin = Origin::Frames {
        frames: file_name(request.frames),
        timestamps: match &request.times {
            FrameTimes::Fps(fps) => format!("{fps} frames per second from 0"),
            FrameTimes::File(path) => file_name(path),
        },
        events: request.events.map(file_name),
    };
    let manifest = Manifest::new(root, origin, SessionStatus::Complete, streams, files, losses);
    let mut journal = Journal::open(&builder.layout.journal())?;
    journal
        .note("import frames", &json!({"origin": manifest.origin, "losses": manifest.losses}))?;
    builder.seal(&manifest)?;
    Ok(manifest)
}

fn frames_entry(frames: &ImportedFrames) -> StreamEntry {
    StreamEntry {
        name: "frames".into(),
        kind: StreamKind::Frames,
        file: "frames/frames.npy".into(),
        stream_id: None,
        size: Some(frames.size),
        count: frames.times.len() as u64,
        first_us: frames.times.first().copied(),
        last_us: frames.times.last().copied(),
        clock: Davis::NAME.into(),
        source: format!("imported, {} bit", frames.bits),
    }
}

fn from_array(request: &ImportFrames<'_>, path: &Path) -> Result<ImportedFrames, SessionError> {
    let wrong = |what: String| SessionError::import(request.frames, what);
    let mut reader = ArrayReader::open(request.frames)?;
    let &[n, height, width] = reader.shape() else {
        return Err(wrong(format!(
            "has shape {:?}; expected N x H x W (brightness, one sample per pixel)",
            reader.shape()
        )));
    };
    let side = |n: u64| u16::try_from(n).ok().filter(|n| *n > 0);
    let (Some(width), Some(height)) = (side(width), side(height)) else {
        return Err(wrong(format!(
            "frames of {width} x {height} pixels; expected 1 to 65535 a side"
        )));
    };
    let size = Size::new(width, height);
    if n == 0 {
        return Err(wrong("holds no frame".into()));
    }
    let times = frame_times(&request.times, n)?;
    let bits = match reader.unsigned_bytes() {
        Some(1) => {
            copy_frames::<u8>(path, size, n, || reader.next_u8(size.n_pixels()))?;
            8
        }
        Some(2) => {
            copy_frames::<u16>(path, size, n, || reader.next_u16(size.n_pixels()))?;
            16
        }
        _ => {
            return Err(wrong(
                "is not of unsigned 8- or 16-bit integers; save it as uint8 or uint16".into(),
            ));
        }
    };
    Ok(ImportedFrames { size, times, bits })
}

fn copy_frames<T: Element>(
    path: &Path,
    size: Size,
    n: u64,
    mut next: impl FnMut() -> Result<Vec<T>, evrig_format::npy::NpyError>,
) -> Result<(), SessionError> {
    let shape = [n, size.height.into(), size.width.into()];
    let mut writer = ArrayWriter::<T>::create(path, &shape)?;
    for _ in 0..n {
        writer.extend(&next()?)?;
    }
    Ok(writer.finish()?)
}

fn from_folder(request: &ImportFrames<'_>, path: &Path) -> Result<ImportedFrames, SessionError> {
    let paths = images::list(request.frames)?;
    let times = frame_times(&request.times, paths.len() as u64)?;
    let (size, first) = images::read_gray(&paths[0])?;
    let bits = match first {
        images::Gray::U8(_) => {
            write_images(path, size, &paths, images::Gray::into_u8)?;
            8
        }
        images::Gray::U16(_) => {
            write_images(path, size, &paths, images::Gray::into_u16)?;
            16
        }
    };
    Ok(ImportedFrames { size, times, bits })
}

/// Writes the images into one array; all must have the size and depth of the first.
fn write_images<T: Element>(
    path: &Path,
    size: Size,
    images: &[PathBuf],
    samples: impl Fn(images::Gray) -> Option<Vec<T>>,
) -> Result<(), SessionError> {
    let shape = [images.len() as u64, size.height.into(), size.width.into()];
    let mut writer = ArrayWriter::<T>::create(path, &shape)?;
    for image in images {
        let (found, gray) = images::read_gray(image)?;
        if found != size {
            let what = format!("is {found}, the first image is {size}; all must have one size");
            return Err(SessionError::import(image, what));
        }
        let samples = samples(gray).ok_or_else(|| {
            let what = "has another bit depth than the first image; use one for all";
            SessionError::import(image, what)
        })?;
        writer.extend(&samples)?;
    }
    Ok(writer.finish()?)
}

/// The time of each of `n` frames, ascending.
fn frame_times(times: &FrameTimes, n: u64) -> Result<Vec<i64>, SessionError> {
    let path = match times {
        FrameTimes::Fps(fps) => {
            return Ok((0..n).map(|i| (i as f64 * 1e6 / fps).round() as i64).collect());
        }
        FrameTimes::File(path) => path,
    };
    let wrong = |what: String| SessionError::import(path, what);
    let found = if path.extension().is_some_and(|ending| ending == "npy") {
        let column = ArrayReader::open(path)?.read_all()?.fields.pop();
        let (_, column) = column.ok_or_else(|| wrong("is empty".into()))?;
        column.into_integers().map_err(|i| wrong(format!("value {i} is no number")))?
    } else {
        times_from_text(path)?
    };
    if found.len() as u64 != n {
        return Err(wrong(format!(
            "has {} times for {n} frames; expected one a frame",
            found.len()
        )));
    }
    match found.windows(2).position(|pair| pair[1] <= pair[0]) {
        None => Ok(found),
        Some(i) => Err(wrong(format!(
            "frame {} at {} us is not later than frame {i} at {} us; sort or remove it",
            i + 1,
            found[i + 1],
            found[i]
        ))),
    }
}

fn times_from_text(path: &Path) -> Result<Vec<i64>, SessionError> {
    let text = std::fs::read_to_string(path).map_err(SessionError::io(path))?;
    let mut times = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        let word = line.rsplit([',', ' ', '\t']).next().unwrap_or(line);
        match word.parse::<f64>() {
            Ok(t) if t.is_finite() => times.push(t.round() as i64),
            // A heading, a comment and empty lines are no times; anything else is a mistake.
            _ if line.is_empty() || line.starts_with('#') || number == 0 => {}
            _ => {
                let what = format!("line {}: expected a time in us, found `{line}`", number + 1);
                return Err(SessionError::import(path, what));
            }
        }
    }
    Ok(times)
}

/// Converts the events into the session's own file.
fn take_events(
    builder: &SessionBuilder,
    request: &ImportFrames<'_>,
    events: &Path,
    size: Size,
) -> Result<(StreamEntry, PathBuf, Vec<DataLoss>), SessionError> {
    let name = &request.events_name;
    let table = event_table::read(events, name.as_str(), size)?;
    let directory = builder.layout.stream(name);
    builder.make_directory(&directory)?;
    let path = directory.join("events.aedat4");
    let source = format!("imported from {}", file_name(events));
    let spec = StreamSpec::events(size, &source);
    let mut writer = Writer::create(&path, Compression::Lz4, &[spec])?;
    writer.write_events(0, table.events.as_slice())?;
    writer.finish()?;
    let times = table.events.as_slice().t;
    let entry = StreamEntry {
        name: name.as_str().into(),
        kind: StreamKind::Events,
        file: format!("streams/{name}/events.aedat4"),
        stream_id: Some(0),
        size: Some(size),
        count: times.len() as u64,
        first_us: times.first().copied(),
        last_us: times.last().copied(),
        clock: Davis::NAME.into(),
        source,
    };
    Ok((entry, path, table.losses))
}
