//! A recording in memory, and why it cannot be read or changed.

use evrig_analysis::filter::FilterError;
use evrig_core::event::Events;
use evrig_core::frame::Frame;
use evrig_core::geometry::Size;
use evrig_core::time::Davis;
use evrig_format::aedat4::{
    Compression, Content, ReadError, Reader, StreamSpec, WriteError, Writer,
};
use std::path::{Path, PathBuf};

/// Why an effect cannot be applied.
#[derive(Debug, thiserror::Error)]
pub enum PlasmodeError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The changed recording cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The recording's events are not what they should be.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// There is nothing to change.
    #[error(
        "{}: has no {what} with a stated size; an effect can be applied to events with frames",
        path.display()
    )]
    Lacks {
        /// The recording.
        path: PathBuf,
        /// What is missing.
        what: &'static str,
    },
    /// No way is known to apply the effect.
    #[error("{id} cannot be applied to a recording; those that can: {}", APPLICABLE.join(", "))]
    NotApplicable {
        /// The effect.
        id: String,
    },
    /// A parameter is missing.
    #[error("{id} needs {key}")]
    Parameter {
        /// The effect.
        id: String,
        /// The parameter's key.
        key: &'static str,
    },
}

/// The effects that can be applied.
pub const APPLICABLE: &[&str] = &[
    "refractory_period",
    "event_drop",
    "dead_pixels",
    "hot_pixels",
    "background_activity",
    "shot_noise",
    "burst_loss",
    "stamp_jitter",
    "clock_offset",
    "clock_skew",
    "black_level",
    "tone_curve",
    "defocus",
];

/// A recording in memory: its events and frames in ascending time.
#[derive(Debug, Clone, PartialEq)]
pub struct PlasmodeRecording {
    /// The event camera's grid.
    pub size: Size,
    /// The events.
    pub events: Events,
    /// The frames.
    pub frames: Vec<Frame<Davis>>,
}

impl PlasmodeRecording {
    /// Reads events and frames of an AEDAT4 file; a cut file gives the data before the cut.
    ///
    /// # Errors
    /// When the file is no AEDAT4 file or has no events or no frames.
    pub fn read(path: &Path) -> Result<Self, PlasmodeError> {
        let lacks = |what| PlasmodeError::Lacks { path: path.to_owned(), what };
        let mut reader = Reader::open(path)?;
        let size = reader.streams().iter().find_map(|stream| stream.size);
        let (mut events, mut frames) = (Events::new(), Vec::new());
        for packet in reader.by_ref().map_while(Result::ok) {
            match packet.content {
                Content::Events(found) => events.extend_from_slice(found.as_slice()),
                Content::Frame(frame) => frames.push(frame),
                _ => {}
            }
        }
        events.sort_by_time();
        if events.is_empty() {
            return Err(lacks("events"));
        }
        if frames.is_empty() {
            return Err(lacks("frames"));
        }
        Ok(Self { size: size.ok_or_else(|| lacks("stream"))?, events, frames })
    }

    /// Writes it as an AEDAT4 file.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn write(&self, path: &Path) -> Result<(), PlasmodeError> {
        let source = "DAVIS346";
        let specs = [StreamSpec::events(self.size, source), StreamSpec::frames(self.size, source)];
        let mut writer = Writer::create(path, Compression::Lz4, &specs)?;
        let all = self.events.as_slice();
        let mut done = 0;
        for frame in &self.frames {
            let until = frame.timing.stamp.as_micros();
            let end = all.t.partition_point(|&t| t < until).max(done);
            writer.write_events(0, all.range(done, end))?;
            writer.write_frame(1, frame)?;
            done = end;
        }
        writer.write_events(0, all.range(done, all.len()))?;
        writer.finish()?;
        Ok(())
    }
}
