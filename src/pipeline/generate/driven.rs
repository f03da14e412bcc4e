//! Generation from the scene: the drive of the event pixels at any time.

use super::affected::all_pixels;
use super::{GenerateRequest, GenerateTally, failed, open};
use crate::pipeline::scene::read_facts;
use crate::pipeline::sync::missing;
use crate::pipeline::{PipelineError, inputs, read_scene};
use evrig_core::drive::Drive;
use evrig_core::event::Events;
use evrig_core::time::Davis;
use evrig_generate::effect::{EffectError, Surroundings};
use evrig_generate::forward::{Forward, ForwardParameters};
use evrig_generate::input::Preparation;
use evrig_generate::{DRIVE_STEP_US, DriveFrames, DriveRun, Law, ModelParameters, build};
use evrig_reconstruct::scene::SceneDrive;
use evrig_session::{RecordedFrame, Session, SessionError, StreamKind, read_stage};
use std::time::{Duration, Instant};

/// Name of the light that the scene gives.
pub(in crate::pipeline) const SCENE: &str = "scene";

/// Whether a light is the scene's: that is its name, and no frame stream has it.
pub(in crate::pipeline) fn is_scene(session: &Session, light: &str) -> bool {
    light == SCENE && session.stream(StreamKind::Frames, SCENE).is_err()
}

/// What the frames behind a session's scene read on the brightest paper, above black, DN; none
/// when the light is not the scene's, or there is no scene yet.
///
/// # Errors
/// When the scene's facts cannot be read.
pub fn white_of(session: &Session, light: &str) -> Result<Option<f64>, PipelineError> {
    let directory = session.layout().derived("scene", None);
    if !is_scene(session, light) || read_stage(&directory).is_none() {
        return Ok(None);
    }
    Ok(Some(read_facts(&directory)?.white_dn))
}

pub(in crate::pipeline) fn drive_of(session: &Session) -> Result<SceneDrive, PipelineError> {
    let scene = read_scene(session)?;
    let none = || missing(session, "it holds no scene; run `evrig scene` first".into());
    Ok(scene.ok_or_else(none)?.drive())
}

/// Checksums of the scene's files.
pub(in crate::pipeline) fn inputs_of(session: &Session) -> inputs::Inputs {
    let record = read_stage(&session.layout().derived("scene", None));
    let files = record.into_iter().flat_map(|record| record.outputs);
    files.map(|(file, sha256)| (format!("derived/scene/{file}"), sha256)).collect()
}

/// As [`super::run`], from the scene's drive.
pub(super) fn run(
    session: &Session,
    request: &GenerateRequest,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    if request.conditions.preparation != Preparation::default() {
        let what = "the scene has no pictures whose colour, pedestal or exposure could be chosen: \
                    it is free of all three; leave these options out";
        return Err(missing(session, what.into()));
    }
    let drive = drive_of(session)?;
    let step_us = request.conditions.interpolate_us.unwrap_or(DRIVE_STEP_US);
    if request.conditions.effects.is_empty() {
        piecewise(session, request, &drive, step_us, progress)
    } else {
        affected(session, request, &drive, step_us)
    }
}

fn piecewise(
    session: &Session,
    request: &GenerateRequest,
    drive: &dyn Drive,
    step_us: u32,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    let mut generator = build(&request.parameters, None)?;
    let frames = DriveFrames::new(drive, [i64::MIN, i64::MAX], step_us)?;
    let grid = frames.grid();
    let mut run = DriveRun::new(frames);
    let mut writer = open(session, &request.name, generator.name(), drive.size())?;
    let mut tally = tally_of(drive, step_us);
    let (mut events, mut spent) = (Events::new(), Duration::ZERO);
    loop {
        events.clear();
        let started = Instant::now();
        let stepped = run.step(generator.as_mut(), &mut events);
        spent += started.elapsed();
        if !stepped.map_err(|source| failed(session, request, source))? {
            break;
        }
        tally.n_frames += 1;
        tally.n_events += events.len() as u64;
        tally.n_on += events.as_slice().count_on() as u64;
        writer.write_events(0, events.as_slice())?;
        progress(tally.n_frames, grid.n as u64);
    }
    writer.finish()?;
    Ok((tally, spent))
}

fn tally_of(drive: &dyn Drive, step_us: u32) -> GenerateTally {
    let [first, last] = drive.span_us();
    let n_steps = (last - first).max(0) / i64::from(step_us.max(1));
    GenerateTally {
        first_us: first,
        last_us: first + n_steps * i64::from(step_us),
        n_pixels: drive.size().n_pixels() as u64,
        ..GenerateTally::default()
    }
}

/// With effects, pixel by pixel: the voltmeter's exact law only.
fn affected(
    session: &Session,
    request: &GenerateRequest,
    drive: &dyn Drive,
    step_us: u32,
) -> Result<(GenerateTally, Duration), PipelineError> {
    let wrong = |source| PipelineError::Forward {
        session: session.root().to_owned(),
        stream: request.from.clone(),
        source: Box::new(source),
    };
    let effects = request.conditions.effects.clone();
    let ModelParameters::Voltmeter { law: Law::Exact, k } = request.parameters.model else {
        let model = request.parameters.model.model().name();
        let id = effects.iter().next().map(|applied| applied.effect.id());
        return Err(match id {
            Some(id) => wrong(EffectError::NotForModel { id, model }.into()),
            None => missing(session, "no effects".into()),
        });
    };
    let surroundings =
        Surroundings { aps_starts_us: aps_starts(session)?, ..Surroundings::default() };
    let forward = Forward::new(ForwardParameters { k, effects, step_us }, surroundings);
    let forward = forward.map_err(wrong)?;
    let size = drive.size();
    let pixels = all_pixels(size);
    let mut tally = tally_of(drive, step_us);
    let started = Instant::now();
    let window = [tally.first_us, tally.last_us];
    let events = forward.run(drive, &pixels, window, request.parameters.seed).map_err(wrong)?;
    let spent = started.elapsed();
    tally.n_frames = ((window[1] - window[0]) / i64::from(step_us)) as u64 + 1;
    tally.n_events = events.events.len() as u64;
    tally.n_on = events.events.as_slice().count_on() as u64;
    let mut writer = open(session, &request.name, request.parameters.model.model().name(), size)?;
    writer.write_events(0, events.events.as_slice())?;
    writer.finish()?;
    Ok((tally, spent))
}

/// Starts of exposure of the event camera's own frames, µs of its clock, ascending; empty where
/// there are none.
pub(in crate::pipeline) fn aps_starts(session: &Session) -> Result<Vec<i64>, PipelineError> {
    if session.stream(StreamKind::Frames, "aps").is_err() {
        return Ok(Vec::new());
    }
    let start = |picture: Result<RecordedFrame<Davis>, SessionError>| {
        let timing = picture?.frame.timing;
        Ok(timing.exposure.map_or(timing.stamp, |[start, _]| start).as_micros())
    };
    let pictures = session.davis_frames("aps")?;
    let mut starts = pictures.map(start).collect::<Result<Vec<_>, PipelineError>>()?;
    starts.sort_unstable();
    Ok(starts)
}
