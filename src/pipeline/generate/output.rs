//! The stream that a generation writes, its counts and its record.

use super::request::GenerateRequest;
use crate::pipeline::error::missing;
use crate::pipeline::{Freshness, PipelineError, clear, fresh_record, inputs};
use evrig_core::event::Events;
use evrig_core::geometry::Size;
use evrig_format::aedat4::{Compression, StreamSpec, Writer};
use evrig_generate::GenerateError;
use evrig_session::{Session, StageRecord, StreamKind, StreamName, write_stage};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::fs::File;
use std::io::BufWriter;
use std::time::Duration;

/// What was generated.
#[derive(Debug, Clone)]
pub struct Generated {
    /// Whether the stage ran now.
    pub freshness: Freshness,
    /// Counts.
    pub tally: GenerateTally,
    /// The stage's record.
    pub record: StageRecord,
    /// How fast the generation alone was; `None` when the result was fresh.
    pub speed: Option<GenerationSpeed>,
}

/// What went in and what came out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct GenerateTally {
    /// Frames, or instants of the scene, that the generator took in.
    pub n_frames: u64,
    /// Frames left out because they are not later than the one before.
    pub n_frames_not_later: u64,
    /// Events made.
    pub n_events: u64,
    /// Of them ON.
    pub n_on: u64,
    /// Time of the first frame, µs; events lie after it.
    pub first_us: i64,
    /// Time of the last frame, µs; no event lies after it.
    pub last_us: i64,
    /// Pixels a frame.
    pub n_pixels: u64,
    /// Frame intervals that were to be filled in the target plane and were filled pixel by pixel.
    #[serde(default)]
    pub n_filled_in_place: u64,
    /// How much of the frames' rhythm is in the events, 0 to 1; none without events.
    #[serde(default)]
    pub frame_rhythm: Option<f64>,
}

/// Time spent in the generator alone, reading and writing left out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GenerationSpeed {
    /// Seconds in the generator.
    pub seconds: f64,
    /// Frames a second.
    pub frames_per_s: f64,
    /// Nanoseconds a pixel and frame.
    pub ns_per_pixel_frame: f64,
    /// Events a second.
    pub events_per_s: f64,
}

impl GenerateTally {
    /// Counts a frame and the events that were made of it.
    pub(super) fn take(&mut self, t_us: i64, made: &Events) {
        self.n_frames += 1;
        self.last_us = t_us;
        self.n_events += made.len() as u64;
        self.n_on += made.as_slice().count_on() as u64;
    }
}

impl GenerationSpeed {
    fn new(spent: Duration, tally: &GenerateTally) -> Self {
        let seconds = spent.as_secs_f64();
        // The first frame only sets the starting brightness.
        let n_steps = tally.n_frames.saturating_sub(1) as f64;
        Self {
            seconds,
            frames_per_s: n_steps / seconds,
            ns_per_pixel_frame: seconds * 1e9 / (n_steps * tally.n_pixels as f64),
            events_per_s: tally.n_events as f64 / seconds,
        }
    }
}

/// Runs `make` unless the stream is fresh; a stream that `make` began before an error is removed.
pub(super) fn stage(
    session: &Session,
    name: &StreamName,
    force: bool,
    inputs: inputs::Inputs,
    parameters: serde_json::Value,
    make: impl FnOnce() -> Result<(GenerateTally, Duration), PipelineError>,
) -> Result<Generated, PipelineError> {
    let wanted = StageRecord::new("generate", Some(name.as_str()), inputs, parameters);
    let directory = session.layout().derived("generate", Some(name));
    if let (false, Some(record)) = (force, fresh_record(&directory, &wanted)) {
        let tally = record.tally_as().unwrap_or_default();
        return Ok(Generated { freshness: Freshness::Fresh, tally, record, speed: None });
    }
    clear(&directory)?;
    let (tally, spent) = make().inspect_err(|_| drop(std::fs::remove_dir_all(&directory)))?;
    let record = StageRecord { tally: json!(tally), ..wanted };
    let record = write_stage(&directory, record, &["events.aedat4"])?;
    let speed = Some(GenerationSpeed::new(spent, &tally));
    Ok(Generated { freshness: Freshness::Ran, tally, record, speed })
}

pub(super) fn refuse_recorded(session: &Session, name: &StreamName) -> Result<(), PipelineError> {
    match session.stream(StreamKind::Events, name.as_str()) {
        Ok(_) => {
            let what = format!("`{name}` is a recorded stream; choose another --name");
            Err(missing(session, what))
        }
        Err(_) => Ok(()),
    }
}

pub(super) fn open(
    session: &Session,
    name: &StreamName,
    model: &str,
    size: Size,
) -> Result<Writer<BufWriter<File>>, PipelineError> {
    let path = session.layout().generated(name);
    let spec = StreamSpec::events(size, &format!("evrig {model}"));
    Ok(Writer::create(&path, Compression::Lz4, &[spec])?)
}

pub(super) fn failed(
    session: &Session,
    request: &GenerateRequest,
    source: GenerateError,
) -> PipelineError {
    PipelineError::Generate {
        session: session.root().to_owned(),
        stream: request.from.clone(),
        source,
    }
}

pub(super) fn too_few(
    session: &Session,
    request: &GenerateRequest,
    n_frames: u64,
) -> PipelineError {
    PipelineError::Missing {
        session: session.root().to_owned(),
        what: format!(
            "stream `{}` has {n_frames} frames; at least two are needed to generate events",
            request.from
        ),
    }
}

pub(super) fn all_pixels(size: Size) -> Vec<(u16, u16)> {
    (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))).collect()
}
