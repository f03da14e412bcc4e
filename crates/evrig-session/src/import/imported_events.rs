//! Events of one stream out of a file of any kind that is read.

use super::event_table::{self, EventSetting, EventTableOptions, check_stamps};
use super::typed_events::{ImportedEvents, TypedEvents};
use crate::epochs::Epochs;
use crate::{DataLoss, SessionError};
use evrig_core::event::Events;
use evrig_core::frame::FrameTiming;
use evrig_core::geometry::Size;
use evrig_core::time::Davis;
use evrig_format::aedat4::{Content, PayloadKind, Reader};
use evrig_format::{CameraEvents, CameraFileError, RecordingNotes, RecordingSink};
use evrig_format::{aedat2, aedat3, prophesee, rosbag, rosbag2};
use std::io::Read;
use std::path::Path;

/// Formats of cameras that hold events, distinguished by their first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CameraFormat {
    Aedat2,
    Aedat3,
    Aedat4,
    Prophesee,
    RosBag,
    RosMcap,
}

impl CameraFormat {
    /// The format of a file that begins with these bytes.
    pub(super) fn of_start(start: &[u8]) -> Option<Self> {
        Some(match start {
            _ if start.starts_with(b"#!AER-DAT4") => Self::Aedat4,
            _ if aedat3::is_header(start) => Self::Aedat3,
            _ if aedat2::is_header(start) => Self::Aedat2,
            _ if rosbag::is_header(start) => Self::RosBag,
            _ if rosbag2::is_header(start) => Self::RosMcap,
            _ => return None,
        })
    }

    /// The format of a file.
    pub(super) fn of_file(path: &Path) -> Result<Option<Self>, SessionError> {
        if path.is_dir() {
            return Ok(holds_mcap(path).then_some(Self::RosMcap));
        }
        let mut start = Vec::new();
        let file = std::fs::File::open(path).map_err(SessionError::io(path))?;
        file.take(16).read_to_end(&mut start).map_err(SessionError::io(path))?;
        if start.starts_with(b"SQLite format 3") {
            return Err(SessionError::import(path, SQLITE_REMEDY));
        }
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let is_binary = matches!(ending.as_deref(), Some("raw" | "dat"));
        let is_prophesee = is_binary && prophesee::is_header(&start);
        Ok(Self::of_start(&start).or(is_prophesee.then_some(Self::Prophesee)))
    }

    /// The format's name.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Aedat2 => "AEDAT 2",
            Self::Aedat3 => "AEDAT 3.1",
            Self::Aedat4 => "AEDAT4",
            Self::Prophesee => "Prophesee",
            Self::RosBag => "ROS bag",
            Self::RosMcap => "ROS 2 MCAP",
        }
    }

    /// Reads a recording of the format; AEDAT4 has its own reader.
    pub(super) fn read(
        self,
        path: &Path,
        size: Option<Size>,
        sink: &mut RecordingSink<'_>,
    ) -> Result<RecordingNotes, CameraFileError> {
        match self {
            Self::Aedat4 => Ok(RecordingNotes::default()),
            Self::Aedat2 => aedat2::read(path, size, sink),
            Self::Aedat3 => aedat3::read(path, sink),
            Self::Prophesee => prophesee::read(path, sink),
            Self::RosBag => rosbag::read(path, sink),
            Self::RosMcap => rosbag2::read(path, sink),
        }
    }
}

/// The container that ROS 2 has replaced by MCAP; SQLite is a quarter of a million lines of C.
pub(super) const SQLITE_REMEDY: &str = "is a ROS 2 recording in SQLite, which is not read; make an \
    MCAP file of it with `mcap convert IN.db3 OUT.mcap` (https://mcap.dev) or `rosbags-convert --src \
    FOLDER --dst OUT --dst-storage mcap` (pip install rosbags)";

/// Whether a folder is a ROS 2 recording in MCAP.
fn holds_mcap(folder: &Path) -> bool {
    let mut entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    folder.join("metadata.yaml").exists()
        && entries.any(|entry| entry.path().extension().is_some_and(|ending| ending == "mcap"))
}

/// Reads the events of a file, by its first bytes and its ending.
pub(super) fn read(
    path: &Path,
    stream: &str,
    options: &EventTableOptions,
    setting: EventSetting,
) -> Result<ImportedEvents, SessionError> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let format = CameraFormat::of_file(path)?;
    if format == Some(CameraFormat::Aedat4) {
        return Ok(read_aedat4(path, stream, options, setting)?.0);
    }
    if let Some(format) = format {
        refuse_table_options(path, options)?;
        let read = |sink: &mut RecordingSink<'_>| format.read(path, setting.size, sink);
        let found = CameraEvents::gather(path, options.table.as_deref(), read)?;
        return of_camera(path, stream, options, setting, found);
    }
    match ending.as_str() {
        ending if event_table::TABLE_ENDINGS.contains(&ending) => {
            event_table::read(path, stream, options, setting)
        }
        _ => Err(SessionError::import(
            path,
            format!(
                "events are read from AEDAT 2, 3.1 and 4, Prophesee's .raw and .dat, ROS 1 .bag, \
                 ROS 2 .mcap and from tables: .{}; `.{ending}` is none of them",
                event_table::TABLE_ENDINGS.join(", .")
            ),
        )),
    }
}

/// Reads the events of an AEDAT4 file, and the timing of its frames.
pub(super) fn read_aedat4(
    path: &Path,
    stream: &str,
    options: &EventTableOptions,
    setting: EventSetting,
) -> Result<(ImportedEvents, Vec<FrameTiming<Davis>>), SessionError> {
    refuse_table_options(path, options)?;
    let mut reader = Reader::open(path)?;
    let streams: Vec<_> =
        reader.streams().iter().filter(|s| s.kind == PayloadKind::Events).cloned().collect();
    let names: Vec<&str> = streams.iter().map(|stream| stream.name.as_str()).collect();
    let wanted = match (options.table.as_deref(), streams.as_slice()) {
        (None, []) => return Err(SessionError::import(path, "has no stream of events")),
        (None, [only]) => only,
        (Some(name), _) if names.contains(&name) => {
            let found = streams.iter().find(|stream| stream.name == name);
            found.unwrap_or(&streams[0])
        }
        _ => {
            let what =
                format!("has the event streams {}; choose one with --topic", names.join(", "));
            return Err(SessionError::import(path, what));
        }
    };
    let mut events = Events::new();
    let mut frames = Vec::new();
    let mut damage = None;
    while let Some(packet) = reader.next() {
        match packet {
            Ok(packet) => match packet.content {
                Content::Events(found) if packet.stream == wanted.id => {
                    events.extend_from_slice(found.as_slice());
                    reader.recycle(found);
                }
                Content::Frame(frame) => frames.push(frame.timing),
                _ => {}
            },
            Err(error) => damage = Some(error.to_string()),
        }
    }
    let size = setting.size.or(wanted.size).unwrap_or(Size::new(1, 1));
    let mut found = finish(stream, options, setting, TypedEvents { events, size })
        .map_err(|what| SessionError::import(path, what))?;
    let loss = |what| DataLoss { stream: stream.to_owned(), what, count: 0 };
    found.losses.extend(damage.map(loss));
    Ok((found, frames))
}

/// Events of a camera's own format, on its sensor or the smallest grid that holds them.
fn of_camera(
    path: &Path,
    stream: &str,
    options: &EventTableOptions,
    setting: EventSetting,
    camera: CameraEvents,
) -> Result<ImportedEvents, SessionError> {
    let CameraEvents { events, size, left_out, damage, mut decisions } = camera;
    if events.is_empty() {
        let what = damage.unwrap_or_else(|| "holds no events".into());
        return Err(SessionError::import(path, what));
    }
    let size = match setting.size.or(size) {
        Some(size) => size,
        None => {
            let side = |values: &[u16]| values.iter().copied().max().unwrap_or(0).saturating_add(1);
            let size = Size::new(side(events.as_slice().x), side(events.as_slice().y));
            let what = "by its outermost events; see --size";
            decisions.push(format!("the sensor has {size} pixels, {what}"));
            size
        }
    };
    let mut found = finish(stream, options, setting, TypedEvents { events, size })
        .map_err(|what| SessionError::import(path, what))?;
    let loss = |what, count| DataLoss { stream: stream.to_owned(), what, count };
    found.losses.extend(damage.map(|what| loss(what, 0)));
    let left_out = left_out.into_iter();
    decisions.extend(left_out.map(|(what, n)| format!("left out: {n} {what}, which are not read")));
    found.decisions = decisions;
    Ok(found)
}

/// Options of tables have no effect on a format that states its own columns and units.
pub(super) fn refuse_table_options(
    path: &Path,
    options: &EventTableOptions,
) -> Result<(), SessionError> {
    let given = [
        ("--time-unit", options.time_unit.is_some()),
        ("--columns", options.columns.is_some()),
        ("--polarity", options.polarity.is_some()),
    ];
    match given.iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some((option, _)) => {
            let what = format!("states its own columns and units; {option} has no effect, omit it");
            Err(SessionError::import(path, what))
        }
    }
}

/// Keeps the chosen epoch of a camera's events, moved to where the user wants its beginning.
fn finish(
    stream: &str,
    options: &EventTableOptions,
    setting: EventSetting,
    mut typed: TypedEvents,
) -> Result<ImportedEvents, String> {
    let size = typed.size;
    let epochs = Epochs::of_stamps(typed.events.as_slice().t);
    if let Some(begin) = options.begin_us {
        let first = typed.events.as_slice().t.iter().copied().min().unwrap_or(0);
        typed.events.shift(begin.saturating_sub(first));
    }
    let found = typed.keep(stream, &epochs, options.epoch, |n, n_outside| {
        let what = || format!("{n_outside} of {n} events are off the {size} grid");
        if 2 * n_outside > n as u64 { Err(what()) } else { Ok(()) }
    })?;
    check_stamps(found.events.as_slice().t)?;
    found.check_overlap(setting)?;
    Ok(found)
}
