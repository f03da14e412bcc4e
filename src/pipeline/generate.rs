//! The stage `generate`: a session's frames become an event stream.

use super::{Freshness, PipelineError, clear, fresh_record, light};
use crate::event::Events;
use crate::format::aedat4::{Compression, StreamSpec, Writer};
use crate::generate::{GenerateParameters, build};
use crate::session::{Session, StageRecord, StreamKind, StreamName, write_stage};
use crate::time::{Clock, Davis};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::time::{Duration, Instant};

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct GenerateRequest {
    /// The light: name of a frame stream.
    pub from: String,
    /// Name of the stream to make.
    pub name: StreamName,
    /// Model, parameters and seed.
    pub parameters: GenerateParameters,
    /// Run even when the result is fresh.
    pub force: bool,
}

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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GenerateTally {
    /// Frames that the generator took in.
    pub n_frames: u64,
    /// Frames left out because they are not later than the one before.
    pub n_frames_not_later: u64,
    /// Events made.
    pub n_events: u64,
    /// Of them On.
    pub n_on: u64,
    /// Time of the first frame, µs; events lie after it.
    pub first_us: i64,
    /// Time of the last frame, µs; no event lies after it.
    pub last_us: i64,
    /// Pixels a frame.
    pub n_pixels: u64,
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

/// The frame stream a generation starts from when nothing else is said.
#[must_use]
pub fn default_light(session: &Session) -> Option<&str> {
    let streams = session.manifest().streams.iter();
    let mut lights = streams.filter(|stream| {
        stream.kind == StreamKind::Frames && stream.count > 1 && stream.clock == Davis::NAME
    });
    lights.next().map(|stream| stream.name.as_str())
}

/// Runs the stage, unless its result is fresh. `progress` is told frames done and in all.
///
/// # Errors
/// When there is no such light, a frame cannot be used, or the disk refuses.
pub fn generate(
    session: &Session,
    request: &GenerateRequest,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Generated, PipelineError> {
    let name = &request.name;
    if session.stream(StreamKind::Events, name.as_str()).is_ok() {
        return Err(PipelineError::Missing {
            session: session.root().to_owned(),
            what: format!("`{name}` is a recorded stream; choose another --name"),
        });
    }
    let frames = session.stream(StreamKind::Frames, &request.from)?;
    let parameters = json!({ "from": request.from, "generator": request.parameters });
    let inputs = light::inputs_of(session, &request.from)?;
    let wanted = StageRecord::new("generate", Some(name.as_str()), inputs, parameters);
    let directory = session.layout().derived("generate", Some(name));
    if let (false, Some(record)) = (request.force, fresh_record(&directory, &wanted)) {
        let tally = serde_json::from_value(record.tally.clone()).unwrap_or_default();
        return Ok(Generated { freshness: Freshness::Fresh, tally, record, speed: None });
    }
    clear(&directory)?;
    let (tally, spent) = run(session, request, frames.count, progress)?;
    let record = StageRecord { tally: json!(tally), ..wanted };
    let record = write_stage(&directory, record, &["events.aedat4"])?;
    let speed = Some(GenerationSpeed::new(spent, &tally));
    Ok(Generated { freshness: Freshness::Ran, tally, record, speed })
}

fn run(
    session: &Session,
    request: &GenerateRequest,
    n_frames: u64,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    let mut frames = light::light(session, &request.from)?;
    let mut generator = build(&request.parameters, None)?;
    let mut writer = None;
    let mut tally = GenerateTally::default();
    let mut spent = Duration::ZERO;
    let mut events = Events::new();
    for frame in frames.by_ref() {
        let frame = frame?;
        if tally.n_frames == 0 {
            tally.first_us = frame.t_us;
            tally.n_pixels = frame.size.n_pixels() as u64;
        }
        events.clear();
        let started = Instant::now();
        generator.push(&frame, &mut events).map_err(|source| PipelineError::Generate {
            session: session.root().to_owned(),
            stream: request.from.clone(),
            source,
        })?;
        spent += started.elapsed();
        tally.n_frames += 1;
        tally.last_us = frame.t_us;
        tally.n_events += events.len() as u64;
        tally.n_on += events.as_slice().count_on() as u64;
        if writer.is_none() {
            let path = session.layout().generated(&request.name);
            let source = format!("evrig {}", generator.name());
            let spec = StreamSpec::events(frame.size, &source);
            writer = Some(Writer::create(&path, Compression::Lz4, &[spec])?);
        }
        if let Some(writer) = &mut writer {
            writer.write_events(0, events.as_slice())?;
        }
        progress(tally.n_frames, n_frames);
    }
    tally.n_frames_not_later = frames.n_not_later();
    let writer = writer.filter(|_| tally.n_frames > 1).ok_or_else(|| PipelineError::Missing {
        session: session.root().to_owned(),
        what: format!(
            "stream `{}` has {} frames; at least two are needed to generate events",
            request.from, tally.n_frames
        ),
    })?;
    writer.finish()?;
    Ok((tally, spent))
}
