//! Reading a session's streams.

use super::{DavisFrames, Session, SessionError, StreamKind, StreamName};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Davis};
use evrig_format::aedat4::{Content, Reader};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Counts of a stream's events on reading; `seen = kept + outside`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct EventTally {
    /// Events in the file, up to the damage if it is damaged.
    pub seen: u64,
    /// Events returned, in ascending time.
    pub kept: u64,
    /// Events left out because they are not on the sensor.
    pub outside: u64,
    /// Events among the kept that were sorted into their place in time.
    pub sorted_in: u64,
}

impl Session {
    /// Names of the event streams that generators made in this session.
    #[must_use]
    pub fn generated_names(&self) -> Vec<StreamName> {
        let derived = self.root().join("derived");
        let entries = std::fs::read_dir(derived).into_iter().flatten().flatten();
        let mut names: Vec<StreamName> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .filter_map(|folder| StreamName::new(folder.strip_prefix("generate-")?).ok())
            .filter(|name| self.layout().generated(name).exists())
            .collect();
        names.sort();
        names
    }

    /// All events of a recorded, imported or generated stream, on the sensor and in ascending time.
    ///
    /// A damaged file gives what precedes the damage, which the manifest states.
    ///
    /// # Errors
    /// When there is no such stream, or its file cannot be opened.
    pub fn events(&self, name: &str) -> Result<(Events, EventTally), SessionError> {
        let (path, id, size) = self.event_source(name)?;
        read_events(&path, id, size)
    }

    /// File, number in the file, and grid of an event stream.
    fn event_source(
        &self,
        name: &str,
    ) -> Result<(std::path::PathBuf, Option<u32>, Option<Size>), SessionError> {
        match self.stream(StreamKind::Events, name) {
            Ok(entry) => Ok((self.layout().inside(&entry.file)?, entry.stream_id, entry.size)),
            Err(not_recorded) => {
                let made = StreamName::new(name).map(|name| self.layout().generated(&name));
                match made {
                    Ok(path) if path.exists() => Ok((path, None, None)),
                    _ => Err(not_recorded),
                }
            }
        }
    }

    /// The pixel grid of the real events, or of the frames where no events state one.
    #[must_use]
    pub fn size(&self) -> Option<Size> {
        let of_kind = |kind| {
            let streams = self.manifest().streams.iter();
            streams.filter(move |stream| stream.kind == kind).find_map(|stream| stream.size)
        };
        of_kind(StreamKind::Events).or_else(|| of_kind(StreamKind::Frames))
    }

    /// The frames of a stream as brightness, in ascending time.
    ///
    /// # Errors
    /// When there is no such stream, or its file cannot be opened.
    pub fn luminance(&self, name: &str) -> Result<LuminanceFrames, SessionError> {
        let entry = self.stream(StreamKind::Frames, name)?;
        if entry.clock != Davis::NAME {
            return Err(self.other_clock(entry));
        }
        let images = self.davis_frames(name)?;
        Ok(LuminanceFrames { images, ascending: AscendingFrames::default() })
    }
}

fn read_events(
    path: &Path,
    id: Option<u32>,
    size: Option<Size>,
) -> Result<(Events, EventTally), SessionError> {
    let reader = Reader::open(path)?;
    let size = size.or_else(|| reader.streams().iter().find_map(|stream| stream.size));
    let mut events = Events::new();
    let mut tally = EventTally::default();
    let mut last = i64::MIN;
    // The damage of a cut file is in the manifest since the import; here it only ends the events.
    for packet in reader.map_while(Result::ok) {
        let Content::Events(found) = packet.content else { continue };
        if id.is_some_and(|id| id != packet.stream) {
            continue;
        }
        let found = found.as_slice();
        tally.seen += found.len() as u64;
        if size.is_none_or(|size| found.first_outside(size).is_none()) {
            events.extend_from_slice(found);
        } else if let Some(size) = size {
            found.iter().filter(|e| size.contains(e.x, e.y)).for_each(|e| events.push(e));
        }
    }
    tally.kept = events.len() as u64;
    tally.outside = tally.seen - tally.kept;
    for &t in events.as_slice().t {
        tally.sorted_in += u64::from(t < last);
        last = last.max(t);
    }
    events.sort_by_time();
    Ok((events, tally))
}

/// Keeps frames in ascending time: passes a frame that is later than the last one that
/// passed, and counts the others.
#[derive(Debug, Clone, Copy, Default)]
pub struct AscendingFrames {
    last_us: Option<i64>,
    n_not_later: u64,
}

impl AscendingFrames {
    /// The next frame of `frames` that is later than the last; an error passes as it is.
    pub fn next(
        &mut self,
        mut frames: impl FnMut() -> Option<Result<Luminance, SessionError>>,
    ) -> Option<Result<Luminance, SessionError>> {
        loop {
            let frame = frames()?;
            if let Ok(frame) = &frame {
                if self.last_us.is_some_and(|last| frame.t_us <= last) {
                    self.n_not_later += 1;
                    continue;
                }
                self.last_us = Some(frame.t_us);
            }
            return Some(frame);
        }
    }

    /// Frames left out so far because they are not later than the frame before them.
    #[must_use]
    pub const fn n_not_later(&self) -> u64 {
        self.n_not_later
    }
}

/// A stream's frames, one after another in ascending time.
pub struct LuminanceFrames {
    images: DavisFrames,
    ascending: AscendingFrames,
}

impl Iterator for LuminanceFrames {
    type Item = Result<Luminance, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        let images = &mut self.images;
        self.ascending.next(|| Some(images.next()?.map(|image| image.frame.luminance())))
    }
}
