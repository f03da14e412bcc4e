//! The stage `generate`: a session's frames become an event stream.

mod affected;
mod diagnosed;
mod driven;

pub(super) use affected::with_effects;
pub use diagnosed::{By, CameraRequest, generate_diagnosed};
pub use driven::white_of;
pub(super) use driven::{SCENE, aps_starts, drive_of, inputs_of as scene_inputs, is_scene};

use super::between::{between, light_under};
use super::sync::missing;
use super::{Freshness, PipelineError, clear, fresh_record, inputs, light};
use evrig_core::event::Events;
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Davis};
use evrig_format::aedat4::{Compression, StreamSpec, Writer};
use evrig_generate::effect::EffectSet;
use evrig_generate::input::FramePreparation;
use evrig_generate::{GenerateError, GenerateParameters, PhaseLocking, RowShift, RowTimes, build};
use evrig_session::{Session, StageRecord, StreamKind, StreamName, write_stage};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::fs::File;
use std::io::BufWriter;
use std::time::{Duration, Instant};

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct GenerateRequest {
    /// The light: name of a frame stream, or `scene`.
    pub from: String,
    /// Name of the stream to make.
    pub name: StreamName,
    /// Model, parameters and seed.
    pub parameters: GenerateParameters,
    /// What is done to the light, and what acts beside the model.
    pub conditions: Conditions,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// Beside the model: how pictures become light, what is put between them, what acts.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Colour, pedestal, exposure.
    #[serde(default)]
    pub preparation: FramePreparation,
    /// Frames are put between frames until none are farther apart, µs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interpolate_us: Option<u32>,
    /// Whether frames are put between frames along the way of the target plane.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub in_plane: bool,
    /// Physical effects.
    #[serde(default, skip_serializing_if = "EffectSet::is_empty")]
    pub effects: EffectSet,
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
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct GenerateTally {
    /// Frames, or instants of the scene, that the generator took in.
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
    fn take(&mut self, t_us: i64, made: &Events) {
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
    refuse_recorded(session, name)?;
    let from_scene = driven::is_scene(session, &request.from);
    let n_frames =
        if from_scene { 0 } else { session.stream(StreamKind::Frames, &request.from)?.count };
    let mut parameters = json!({ "from": request.from, "generator": request.parameters });
    // Each row at its own time; before, all had the middle one's.
    parameters["times"] = json!("row");
    if request.conditions != Conditions::default() {
        parameters["conditions"] = json!(request.conditions);
    }
    let inputs = if from_scene {
        driven::inputs_of(session)
    } else {
        light::inputs_of(session, &request.from)?
    };
    stage(session, name, request.force, inputs, parameters, || {
        if from_scene {
            driven::run(session, request, progress)
        } else {
            run(session, request, n_frames, progress)
        }
    })
}

/// The stage about a generation: nothing is made where its result is fresh, and what `make` made before
/// an error is no stream.
fn stage(
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

fn refuse_recorded(session: &Session, name: &StreamName) -> Result<(), PipelineError> {
    match session.stream(StreamKind::Events, name.as_str()) {
        Ok(_) => {
            let what = format!("`{name}` is a recorded stream; choose another --name");
            Err(missing(session, what))
        }
        Err(_) => Ok(()),
    }
}

fn run(
    session: &Session,
    request: &GenerateRequest,
    n_frames: u64,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    let conditions = &request.conditions;
    let mut frames = light_under(session, &request.from, conditions)?;
    if !conditions.effects.is_empty() {
        return affected::run(session, request, &mut frames, n_frames, progress);
    }
    let mut generator = build(&request.parameters, None)?;
    let mut between = between(session, &request.from, conditions)?;
    let (mut shift, mut rhythm) = (RowShift::default(), PhaseLocking::default());
    let mut writer = None;
    let mut tally = GenerateTally::default();
    let mut spent = Duration::ZERO;
    let (mut made, mut events) = (Events::new(), Events::new());
    // Not a `for`, since the rows' times are asked for in between.
    while let Some(frame) = frames.next() {
        let frame = frame?;
        let (t_us, size) = (frame.t_us, frame.size);
        let rows = frames.rows(size);
        if tally.n_frames == 0 {
            tally.first_us = t_us;
            tally.n_pixels = size.n_pixels() as u64;
        }
        made.clear();
        events.clear();
        let started = Instant::now();
        between.set_rows(rows);
        let pushed = between.push(frame, |frame| generator.push(frame, &mut made));
        pushed.map_err(|source| failed(session, request, source))?;
        rhythm.add(made.as_slice(), tally.last_us, t_us - tally.last_us);
        let rows = if between.is_of_one_instant() { RowTimes::default() } else { rows };
        shift.push(rows, size, t_us, &made, &mut events);
        spent += started.elapsed();
        tally.take(t_us, &made);
        if writer.is_none() {
            writer = Some(open(session, &request.name, generator.name(), size)?);
        }
        if let Some(writer) = &mut writer {
            writer.write_events(0, events.as_slice())?;
        }
        progress(tally.n_frames, n_frames);
    }
    tally.n_frames_not_later = frames.n_not_later();
    tally.n_filled_in_place = between.n_in_place();
    tally.frame_rhythm = Some(rhythm.strength()).filter(|strength| strength.is_finite());
    let mut writer = writer
        .filter(|_| tally.n_frames > 1)
        .ok_or_else(|| too_few(session, request, tally.n_frames))?;
    events.clear();
    shift.finish(&mut events);
    writer.write_events(0, events.as_slice())?;
    writer.finish()?;
    Ok((tally, spent))
}

fn open(
    session: &Session,
    name: &StreamName,
    model: &str,
    size: Size,
) -> Result<Writer<BufWriter<File>>, PipelineError> {
    let path = session.layout().generated(name);
    let spec = StreamSpec::events(size, &format!("evrig {model}"));
    Ok(Writer::create(&path, Compression::Lz4, &[spec])?)
}

fn failed(session: &Session, request: &GenerateRequest, source: GenerateError) -> PipelineError {
    PipelineError::Generate {
        session: session.root().to_owned(),
        stream: request.from.clone(),
        source,
    }
}

fn too_few(session: &Session, request: &GenerateRequest, n_frames: u64) -> PipelineError {
    PipelineError::Missing {
        session: session.root().to_owned(),
        what: format!(
            "stream `{}` has {n_frames} frames; at least two are needed to generate events",
            request.from
        ),
    }
}
