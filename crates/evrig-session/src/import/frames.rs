//! ImportedFrames from an array or a folder, with events of the same grid if there are any.

use super::builder::SessionBuilder;
use super::event_table::{EventSetting, EventTableOptions, TimeUnit};
use super::frame_times::{self, DecidedTimes, FrameTimes};
use super::raw_frames::{self, RAW_ENDINGS, RawFrameOptions};
use super::typed_events::ImportedEvents;
use super::{images, imported_events};
use crate::manifest::file_name;
use crate::{
    Journal, Manifest, Origin, SessionError, SessionStatus, StreamEntry, StreamKind, StreamName,
};
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Davis};
use evrig_format::aedat4::{Compression, StreamSpec, Writer};
use evrig_format::npy::{ArrayReader, ArrayWriter, Element};
use serde_json::json;
use std::path::{Path, PathBuf};

/// What to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportFrames<'a> {
    /// An npy array of N x H x W, u8 or u16, or a folder of images.
    pub frames: &'a Path,
    /// When each frame was.
    pub times: FrameTimes,
    /// The unit of these times, where the user states it.
    pub frame_time_unit: Option<TimeUnit>,
    /// Events of the same pixel grid and clock.
    pub events: Option<&'a Path>,
    /// The events' stream name: `real`, or any other for events simulated elsewhere.
    pub events_name: StreamName,
    /// What the user states about the events.
    pub options: EventTableOptions,
    /// What the user states about frames without a description.
    pub raw: RawFrameOptions,
}

/// The frames' stream once its array is written.
struct ImportedFrames {
    size: Size,
    times: DecidedTimes,
    bits: u8,
}

/// Makes a session of frames and, if given, events.
///
/// # Errors
/// When a file is not what it should be, the times do not ascend or are not as many as the
/// frames, `root` is taken, or writing fails.
pub fn import_frames(request: &ImportFrames<'_>, root: &Path) -> Result<Manifest, SessionError> {
    check_kind(request.frames)?;
    let builder = SessionBuilder::take(root)?;
    let directory = builder.layout.frames();
    builder.make_directory(&directory)?;
    let path = directory.join("frames.npy");
    let frames = if request.frames.is_dir() {
        from_folder(request, &path)?
    } else if is_raw(request.frames) {
        let given = raw_frames::RawFrameFile {
            path: request.frames,
            options: request.raw,
            times: &request.times,
            time_unit: request.frame_time_unit,
        };
        let raw_frames::RawArray { size, times, bits } = raw_frames::write_array(&given, &path)?;
        ImportedFrames { size, times, bits }
    } else {
        from_array(request, &path)?
    };
    let times_path = directory.join("timestamps_us.npy");
    let t_us = &frames.times.t_us;
    let mut times = ArrayWriter::create(&times_path, &[t_us.len() as u64])?;
    times.extend(t_us)?;
    times.finish()?;

    let mut streams = vec![frames_entry(&frames)];
    let mut files = vec![builder.file_entry(&path)?, builder.file_entry(&times_path)?];
    let mut losses = Vec::new();
    let mut decisions = frames.times.decisions.clone();
    if let Some(events) = request.events {
        let frames_us = t_us.first().copied().zip(t_us.last().copied()).map(<[i64; 2]>::from);
        let setting = EventSetting { size: Some(frames.size), frames_us };
        let name = &request.events_name;
        let found = imported_events::read(events, name.as_str(), &request.options, setting)?;
        let (entry, events_path) = write_events(&builder, name, events, &found)?;
        files.push(builder.file_entry(&events_path)?);
        streams.push(entry);
        losses = found.losses;
        decisions.extend(found.decisions);
    }
    let origin = Origin::Frames {
        frames: file_name(request.frames),
        timestamps: match &request.times {
            FrameTimes::Fps(fps) => format!("{fps} frames per second from 0"),
            FrameTimes::File(path) => file_name(path),
            FrameTimes::Names => "numbers in the names of the images".into(),
        },
        events: request.events.map(file_name),
    };
    let manifest = Manifest::new(root, origin, SessionStatus::Complete, streams, files, losses);
    let manifest = Manifest { decisions, ..manifest };
    let mut journal = Journal::open(&builder.layout.journal())?;
    let note = json!({
        "origin": manifest.origin, "decisions": manifest.decisions, "losses": manifest.losses,
    });
    journal.note("import frames", &note)?;
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
        count: frames.times.t_us.len() as u64,
        first_us: frames.times.t_us.first().copied(),
        last_us: frames.times.t_us.last().copied(),
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
    let times = frame_times::decide(&request.times, request.frame_time_unit, n, &[])?;
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
    let n = paths.len() as u64;
    let times = frame_times::decide(&request.times, request.frame_time_unit, n, &paths)?;
    let (size, first) = images::read_gray(&paths[0].path)?;
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
    images: &[images::NamedImage],
    samples: impl Fn(images::Gray) -> Option<Vec<T>>,
) -> Result<(), SessionError> {
    let shape = [images.len() as u64, size.height.into(), size.width.into()];
    let mut writer = ArrayWriter::<T>::create(path, &shape)?;
    for image in images.iter().map(|image| image.path.as_path()) {
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

/// Writes imported events into the session's own file.
pub(super) fn write_events(
    builder: &SessionBuilder,
    name: &StreamName,
    source: &Path,
    found: &ImportedEvents,
) -> Result<(StreamEntry, PathBuf), SessionError> {
    let directory = builder.layout.stream(name);
    builder.make_directory(&directory)?;
    let path = directory.join("events.aedat4");
    let source = format!("imported from {}", file_name(source));
    let spec = StreamSpec::events(found.size, &source);
    let mut writer = Writer::create(&path, Compression::Lz4, &[spec])?;
    writer.write_events(0, found.events.as_slice())?;
    writer.finish()?;
    let times = found.events.as_slice().t;
    let entry = StreamEntry {
        name: name.as_str().into(),
        kind: StreamKind::Events,
        file: format!("streams/{name}/events.aedat4"),
        stream_id: Some(0),
        size: Some(found.size),
        count: times.len() as u64,
        first_us: times.first().copied(),
        last_us: times.last().copied(),
        clock: Davis::NAME.into(),
        source,
    };
    Ok((entry, path))
}

/// Whether a file holds frames without a description, by its ending.
pub(super) fn is_raw(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    ending.is_some_and(|ending| RAW_ENDINGS.contains(&ending.as_str()))
}

/// Refuses files that hold frames in a form that is not read, with what makes readable ones.
fn check_kind(path: &Path) -> Result<(), SessionError> {
    if !path.exists() {
        return Err(SessionError::import(path, "there is no such file or folder"));
    }
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let name = path.display();
    let what = match ending.as_str() {
        _ if path.is_dir() => return Ok(()),
        "mp4" | "mkv" | "avi" | "mov" | "webm" | "m4v" | "h264" => format!(
            "is a video; make images of it first: mkdir frames && ffmpeg -i '{name}' -fps_mode \
             passthrough frames/%06d.png, then give the folder and the video's rate with --fps"
        ),
        "yuv" | "dng" => "holds frames in YUV or DNG, which are not read; unpack them into an npy \
             array of N x H x W, uint16"
            .into(),
        "npz" => "is an archive of arrays; save the frames alone with numpy.save".into(),
        _ => return Ok(()),
    };
    Err(SessionError::import(path, what))
}
