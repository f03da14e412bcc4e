//! Streams of a session in the formats that other programs read.
//!
//! | format | what | read with |
//! | --- | --- | --- |
//! | npz | int64 (N, 4): t_us, x, y, p; frames, inertial samples and triggers as arrays | NumPy |
//! | hdf5 | DSEC's layout, gzip | h5py, loaders of DSEC |
//! | parquet | columns t, x, y, p | pandas, polars, DuckDB |
//! | csv | columns t (us), x, y, p | spreadsheets, pandas |
//! | txt | lines of t (s), x, y, p, as the Event-Camera Dataset | its readers |
//! | zip | one text of lines of t (s), x, y, p below the sensor's size | rpg_e2vid |
//! | aedat4 | events | DV, dv-processing |
//! | raw | EVT 3.0 | Metavision, faery |
//! | v2e | HDF5 in v2e's layout: `events` (N, 4), uint32 | readers of v2e |
//! | ros2 | MCAP with event_camera_msgs/EventPacket | ROS 2, event_camera_py |
//! | gif, mp4 | images of 20 ms | viewers; mp4 needs ffmpeg |
//! | mcap | event images, frames and the target's outline | Foxglove (with a layout file), Rerun |
//! | rrd | the same in Rerun's own format, with the feature `rerun` | Rerun |
//!
//! Times are microseconds of the events' clock. Metadata is in the file where the format allows it,
//! and always in `<file>.json` next to it.

mod animation;
mod images;
mod mcap;
mod npz;
mod pi_frames;
#[cfg(feature = "rerun")]
mod rerun;
mod side;
mod text;
mod viewer;
mod window;

pub use npz::ExportedArray;

use crate::pipeline::{self, PipelineError};
use evrig_core::event::Events;
use evrig_core::geometry::Size;
use evrig_format::aedat4::{Compression, StreamSpec, WriteError, Writer};
use evrig_format::{hdf5, parquet, prophesee, rosbag2};
use evrig_session::{Session, SessionError, StreamEntry, StreamKind, StreamName};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What to write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportRequest {
    /// Name of the stream, recorded or generated.
    pub stream: String,
    /// Its kind, for a name shared by frames and the events generated from them; events by default.
    pub kind: Option<StreamKind>,
    /// The file.
    pub out: PathBuf,
    /// Its format.
    pub format: ExportFormat,
    /// Which of the events, in which coordinates.
    pub cut: EventSelection,
}

/// A format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExportFormat {
    /// NumPy arrays in one file.
    Npz,
    /// HDF5 in DSEC's layout.
    Hdf5,
    /// A Parquet table.
    Parquet,
    /// Text with a heading, times in us.
    Csv,
    /// Text of the Event-Camera Dataset, times in seconds.
    Txt,
    /// An archive of one text, times in seconds, as rpg_e2vid reads it.
    Zip,
    /// AEDAT4.
    Aedat4,
    /// EVT 3.0 of Prophesee.
    Raw,
    /// HDF5 in v2e's layout.
    V2e,
    /// MCAP with event_camera_msgs of ROS 2.
    Ros2,
    /// An animation of event images.
    Gif,
    /// A video of event images, encoded by ffmpeg.
    Mp4,
    /// MCAP for viewers.
    Mcap,
    /// Rerun's own format; only where evrig was built with the feature `rerun`.
    Rrd,
}

/// Which events of a stream, in which coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EventSelection {
    /// All of them, in sensor pixels.
    Whole,
    /// Those that the stage `filter` kept, in target coordinates where it transformed to them.
    Picture,
    /// The same on a square canvas of this many pixels.
    Canvas(u16),
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Exported {
    /// The file.
    pub path: PathBuf,
    /// Metadata files; none for streams that are not events.
    pub beside: Vec<PathBuf>,
    /// Events written.
    pub n_events: Option<u64>,
    /// Arrays of an npz.
    pub arrays: Vec<ExportedArray>,
    /// Whether another stream has the same name.
    pub has_namesake: bool,
    /// Image streams without metadata, with the reason.
    pub left_out: Vec<String>,
}

/// Why a stream cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The session cannot be read, or an npz not written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A result cannot be read.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// An HDF5 file cannot be written.
    #[error(transparent)]
    Hdf5(#[from] hdf5::Hdf5Error),
    /// A Parquet file cannot be written.
    #[error(transparent)]
    Parquet(#[from] parquet::TableError),
    /// An AEDAT4 file cannot be written.
    #[error(transparent)]
    Aedat4(#[from] WriteError),
    /// An MCAP file cannot be written.
    #[error("{path}: cannot be written: {source}", path = path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: Box<::mcap::McapError>,
    },
    /// An rrd file cannot be written.
    #[error("{path}: cannot be written: {what}", path = path.display())]
    Rerun {
        /// The file.
        path: PathBuf,
        /// The reason.
        what: String,
    },
    /// The stream cannot be exported in this way.
    #[error("stream `{stream}` of {session}: {what}", session = session.display())]
    Unfit {
        /// The session.
        session: PathBuf,
        /// The stream.
        stream: String,
        /// Why, and what to do.
        what: String,
    },
    /// The system returned an error.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

/// Events that are ready to be written.
struct Chosen {
    events: Events,
    size: Size,
}

/// Writes a stream and its metadata. An incomplete file is removed.
///
/// # Errors
/// When there is no such stream, it cannot be exported in this format or selection, or the disk refuses.
pub fn export(session: &Session, request: &ExportRequest) -> Result<Exported, ExportError> {
    // A session's files are evidence; none of them may be written over.
    if is_part_of(session, &request.out) {
        return Err(unfit(session, request, "--out names a file of the session itself".into()));
    }
    let was_there = request.out.exists();
    let made = write(session, request);
    if made.is_err() && !was_there {
        let _ = std::fs::remove_file(&request.out);
    }
    made
}

/// The recorded stream of the request, unless events are requested.
fn recorded<'a>(session: &'a Session, request: &ExportRequest) -> (Option<&'a StreamEntry>, bool) {
    let mut all = session.manifest().streams.iter();
    let other = all.find(|s| s.name == request.stream && s.kind != StreamKind::Events);
    let has_events = session.stream(StreamKind::Events, &request.stream).is_ok()
        || session.generated_names().iter().any(|name| name.as_str() == request.stream);
    let is_meant = match request.kind {
        Some(kind) => kind != StreamKind::Events,
        None => !has_events,
    };
    (other.filter(|_| is_meant), has_events && other.is_some())
}

fn write(session: &Session, request: &ExportRequest) -> Result<Exported, ExportError> {
    let (recorded, has_namesake) = recorded(session, request);
    if let Some(entry) = recorded {
        if request.format != ExportFormat::Npz || request.cut != EventSelection::Whole {
            let what = format!("it holds {}; only --format npz, uncut, takes them", entry.kind);
            return Err(unfit(session, request, what));
        }
        let is_logged = entry.kind == StreamKind::Frames && entry.file.ends_with(".mcap");
        let arrays = if is_logged {
            Some(pi_frames::write(session, entry, &request.out)?)
        } else {
            npz::recorded(session, entry, &request.out)?
        };
        let arrays = arrays.ok_or_else(|| {
            let what = format!("it holds {}; rig.mcap is their format already", entry.kind);
            unfit(session, request, what)
        })?;
        let (path, beside, left_out) = (request.out.clone(), Vec::new(), Vec::new());
        return Ok(Exported { path, beside, n_events: None, arrays, has_namesake, left_out });
    }
    if let Some(kind) = request.kind.filter(|kind| *kind != StreamKind::Events) {
        session.stream(kind, &request.stream)?;
    }
    let chosen = choose(session, request)?;
    let times = chosen.events.as_slice().t;
    let (images, mut left_out) = images::read(session, times)?;
    if request.format == ExportFormat::Mp4 {
        left_out.extend(animation::mp4(session, request, &chosen)?);
    }
    let side = side::Sidecar::new(session, request, &chosen, &images, left_out)?;
    let (arrays, mut beside) = write_events(session, request, &chosen, &images, &side.heading())?;
    let out = &request.out;
    beside.push(side.write(out)?);
    let n_events = Some(chosen.events.len() as u64);
    let (path, left_out) = (out.clone(), side.left_out);
    Ok(Exported { path, beside, n_events, arrays, has_namesake, left_out })
}

/// Writes events in the format of the request; gives the arrays of an npz and the files beside it.
fn write_events(
    session: &Session,
    request: &ExportRequest,
    chosen: &Chosen,
    images: &[images::Images],
    heading: &str,
) -> Result<(Vec<ExportedArray>, Vec<PathBuf>), ExportError> {
    let (out, events) = (&request.out, chosen.events.as_slice());
    let mut arrays = Vec::new();
    let mut beside = Vec::new();
    let groups: Vec<hdf5::SideGroup> = images.iter().map(images::Images::group).collect();
    match request.format {
        ExportFormat::Npz => arrays = npz::events(events, &groups, out)?,
        ExportFormat::Hdf5 => hdf5::write_dsec(out, events, &groups, heading)?,
        ExportFormat::Parquet => {
            parquet::write_events(out, events, &[("evrig", heading.to_owned())])?;
        }
        ExportFormat::Csv | ExportFormat::Txt => {
            text::write(out, events, request.format == ExportFormat::Txt)?;
        }
        ExportFormat::Zip => text::write_zip(out, events, chosen.size)?,
        ExportFormat::V2e => hdf5::write_v2e(out, events)?,
        ExportFormat::Raw | ExportFormat::Ros2 => words(session, request, chosen)?,
        ExportFormat::Gif => animation::gif(out, chosen)?,
        // Written before the metadata, which state what it leaves out.
        ExportFormat::Mp4 => {}
        ExportFormat::Aedat4 => aedat4(out, chosen, &request.stream)?,
        ExportFormat::Mcap => {
            mcap::write(session, request, chosen, images)?;
            beside.push(viewer::write(out, &request.stream, images)?);
        }
        #[cfg(feature = "rerun")]
        ExportFormat::Rrd => rerun::write(session, request, chosen, images, heading)?,
        #[cfg(not(feature = "rerun"))]
        ExportFormat::Rrd => {
            let what = "this evrig was built without rrd files; build it with `cargo install --path . \
                        --locked --features rerun`, or take --format mcap, which Rerun opens as well";
            return Err(unfit(session, request, what.into()));
        }
    }
    Ok((arrays, beside))
}

fn choose(session: &Session, request: &ExportRequest) -> Result<Chosen, ExportError> {
    let stream = StreamName::new(&request.stream)?;
    if request.cut == EventSelection::Whole {
        let (events, _) = session.events(stream.as_str())?;
        let size = pipeline::stream_grid(session, &stream)?;
        return Ok(Chosen { events, size });
    }
    // The error of a missing stream lists the existing ones.
    pipeline::stream_grid(session, &stream).or_else(|_| {
        session.events(stream.as_str()).map(|_| Size::new(1, 1)).map_err(ExportError::from)
    })?;
    let found = pipeline::picture_events(session, &stream)?.ok_or_else(|| {
        let what =
            "it was not filtered as it is now; run `evrig filter` (or `evrig process`) first";
        unfit(session, request, what.into())
    })?;
    let (events, size) = found;
    Ok(match request.cut {
        EventSelection::Canvas(side) => canvas(&events, size, side),
        _ => Chosen { events, size },
    })
}

/// The events on another grid: each in the cell that holds the centre of its pixel.
fn canvas(events: &Events, from: Size, side: u16) -> Chosen {
    let place = |v: u16, n: u16| {
        ((2 * u32::from(v) + 1) * u32::from(side) / (2 * u32::from(n.max(1)))) as u16
    };
    let moved = events.as_slice().iter().map(|event| evrig_core::event::Event {
        x: place(event.x, from.width),
        y: place(event.y, from.height),
        ..event
    });
    Chosen { events: moved.collect(), size: Size::new(side, side) }
}

fn aedat4(out: &Path, chosen: &Chosen, stream: &str) -> Result<(), ExportError> {
    let spec = StreamSpec::events(chosen.size, &format!("evrig {stream}"));
    let mut writer = Writer::create(out, Compression::Lz4, &[spec])?;
    writer.write_events(0, chosen.events.as_slice())?;
    writer.finish()?;
    Ok(())
}

/// Writes the words of EVT 3.0, in a file of Prophesee's or in messages.
fn words(session: &Session, request: &ExportRequest, chosen: &Chosen) -> Result<(), ExportError> {
    let (out, events, size) = (&request.out, chosen.events.as_slice(), chosen.size);
    if size.width.max(size.height) > prophesee::MAX_EVT3_SIDE {
        let what = format!("it has {size} pixels; EVT 3.0 addresses at most 2048 a side");
        return Err(unfit(session, request, what));
    }
    if request.format == ExportFormat::Raw {
        let written = prophesee::write_evt3(out, events, size);
        return written.map_err(|source| ExportError::Io { path: out.clone(), source });
    }
    if let Some(first) = events.t.first().filter(|t| **t < 0) {
        let what = format!("it begins at {first} us; an MCAP file holds no time before 0");
        return Err(unfit(session, request, what));
    }
    let written = rosbag2::write_packets(out, &format!("/{}/events", request.stream), events, size);
    written.map_err(|source| ExportError::Mcap { path: out.clone(), source: Box::new(source) })
}

/// Whether a path is one of the session's recorded files, its manifest, or a result.
fn is_part_of(session: &Session, out: &Path) -> bool {
    let real = |path: &Path| path.canonicalize().ok();
    let (Some(root), Some(out)) = (real(session.root()), real(out)) else { return false };
    let Ok(inside) = out.strip_prefix(&root) else { return false };
    let name = inside.to_string_lossy();
    name == "session.json"
        || inside.starts_with("derived")
        || session.manifest().files.contains_key(name.as_ref())
}

fn unfit(session: &Session, request: &ExportRequest, what: String) -> ExportError {
    let session = session.root().to_owned();
    ExportError::Unfit { session, stream: request.stream.clone(), what }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::Event;

    #[test]
    fn a_canvas_takes_each_pixel_where_its_middle_lies() {
        let event = |x, y| Event { t: 0, x, y, on: true };
        let events: Events = [event(0, 0), event(99, 99), event(50, 49)].into_iter().collect();
        let made = canvas(&events, Size::new(100, 100), 80);
        assert_eq!(made.events.as_slice().x, [0, 79, 40]);
        assert_eq!(made.events.as_slice().y, [0, 79, 39]);
        let same = canvas(&events, Size::new(100, 100), 100);
        assert_eq!(same.events, events);
    }
}
