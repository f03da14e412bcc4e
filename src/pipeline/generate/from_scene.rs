//! Generation from the scene: the log-intensity signal of the event pixels at any time.

use super::output::{GenerateTally, all_pixels, failed, open};
use super::request::GenerateRequest;
use crate::pipeline::PipelineError;
use crate::pipeline::error::missing;
use crate::pipeline::luminance::aps_starts;
use crate::pipeline::scene_source::drive_of;
use evrig_core::drive::Drive;
use evrig_core::event::Events;
use evrig_generate::effect::{EffectError, RecordingContext};
use evrig_generate::forward::{ForwardParameters, ForwardSimulator};
use evrig_generate::input::FramePreparation;
use evrig_generate::{DRIVE_STEP_US, DriveFrames, DriveRun, ModelParameters, VoltmeterLaw, build};
use evrig_session::Session;
use std::time::{Duration, Instant};

/// As [`super::run`], from the scene's drive.
pub(super) fn run(
    session: &Session,
    request: &GenerateRequest,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    if request.conditions.preparation != FramePreparation::default() {
        let what = "a scene has no frames, so that colour, black level and exposure do not apply; \
                    leave these options out";
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

/// With effects, pixel by pixel; only by the voltmeter's exact law.
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
    let ModelParameters::Voltmeter { law: VoltmeterLaw::Exact, k } = request.parameters.model
    else {
        let model = request.parameters.model.model().name();
        let id = effects.iter().next().map(|applied| applied.effect.id());
        return Err(match id {
            Some(id) => wrong(EffectError::NotForModel { id, model }.into()),
            None => missing(session, "no effects".into()),
        });
    };
    let surroundings =
        RecordingContext { aps_starts_us: aps_starts(session)?, ..RecordingContext::default() };
    let forward = ForwardSimulator::new(ForwardParameters { k, effects, step_us }, surroundings);
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
