//! Generation with effects: all frames are held, since a pixel is followed from first to last.

use super::{GenerateRequest, GenerateTally, driven, failed, open, too_few};
use crate::pipeline::PipelineError;
use crate::pipeline::between::between;
use crate::pipeline::light::Light;
use crate::pipeline::sync::missing;
use evrig_core::drive::{Drive, SignalCurve, TimeGrid};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_generate::effect::{EffectError, Enters, Surroundings};
use evrig_generate::forward::{Forward, ForwardError, ForwardParameters};
use evrig_generate::voltmeter::Coefficients;
use evrig_generate::{Law, ModelParameters, RowTimes, build};
use evrig_reconstruct::scene::FramesDrive;
use evrig_session::Session;
use std::time::{Duration, Instant};

/// The most that frames may take in memory, bytes; they are held twice, as they are and as light.
const MOST_BYTES: usize = 3 << 30;

/// The step at which light is taken, µs.
const STEP_US: u32 = 1_000;

pub(super) fn run(
    session: &Session,
    request: &GenerateRequest,
    light: &mut Light,
    n_frames: u64,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    let mut frames: Vec<Luminance> = Vec::new();
    for frame in light.by_ref() {
        let frame = frame?;
        let bytes = frame.size.n_pixels() * 8 * (frames.len() + 1);
        if bytes > MOST_BYTES {
            let what = format!(
                "the frames of `{}` take more than {} GB; effects need them all at once: cut the \
                 session, or leave the effects out",
                request.from,
                MOST_BYTES >> 30
            );
            return Err(missing(session, what));
        }
        frames.push(frame);
        progress(frames.len() as u64, n_frames);
    }
    let [first, .., last] = frames.as_slice() else {
        return Err(too_few(session, request, frames.len() as u64));
    };
    let mut tally = GenerateTally {
        n_frames: frames.len() as u64,
        n_frames_not_later: light.n_not_later(),
        first_us: first.t_us,
        last_us: last.t_us,
        n_pixels: first.size.n_pixels() as u64,
        ..GenerateTally::default()
    };
    let size = first.size;
    let rows = light.rows(size);
    let started = Instant::now();
    let events = with_effects(session, request, frames, rows)?;
    let spent = started.elapsed();
    tally.n_events = events.len() as u64;
    tally.n_on = events.as_slice().count_on() as u64;
    let mut writer = open(session, &request.name, request.parameters.model.model().name(), size)?;
    writer.write_events(0, events.as_slice())?;
    writer.finish()?;
    Ok((tally, spent))
}

/// The events of frames with the request's effects.
///
/// The voltmeter runs on the frames' light at any time. Another model takes frames that the effects
/// before its photoreceptor have changed, and its events pass the readout; it cannot be changed inside.
pub(in crate::pipeline) fn with_effects(
    session: &Session,
    request: &GenerateRequest,
    mut frames: Vec<Luminance>,
    rows: RowTimes,
) -> Result<Events, PipelineError> {
    let wrong = |source: ForwardError| PipelineError::Forward {
        session: session.root().to_owned(),
        stream: request.from.clone(),
        source: Box::new(source),
    };
    let surroundings = surroundings(session, request, &frames)?;
    let exact = match request.parameters.model {
        ModelParameters::Voltmeter { law: Law::Exact, k } => Some(k),
        _ => None,
    };
    let parameters = ForwardParameters {
        k: exact.unwrap_or(Coefficients::DVS346),
        effects: request.conditions.effects.clone(),
        step_us: STEP_US,
    };
    let forward = Forward::new(parameters, surroundings).map_err(wrong)?;
    // The drive counts from the first row's time.
    let first_us = rows.after_us(0.0).round() as i64;
    frames.iter_mut().for_each(|frame| frame.t_us += first_us);
    let drive =
        FramesDrive::new(&frames, 0.0, rows.row_us).map_err(|source| PipelineError::Frames {
            session: session.root().to_owned(),
            stream: request.from.clone(),
            source,
        })?;
    let window = drive.span_us();
    let size = drive.size();
    let pixels = all_pixels(size);
    let seed = request.parameters.seed;
    if exact.is_some() {
        drop(frames);
        return Ok(forward.run(&drive, &pixels, window, seed).map_err(wrong)?.events);
    }
    refuse_what_acts_inside(request).map_err(|source| wrong(source.into()))?;
    relight(&forward, &drive, &mut frames);
    drop(drive);
    let mut generator = build(&request.parameters, None)?;
    let mut between = between(session, &request.from, &request.conditions)?;
    let mut events = Events::new();
    for frame in frames {
        let pushed = between.push(frame, |frame| generator.push(frame, &mut events));
        pushed.map_err(|source| failed(session, request, source))?;
    }
    forward.readout(&mut events, size, &pixels, window, seed);
    Ok(events)
}

pub(super) fn all_pixels(size: Size) -> Vec<(u16, u16)> {
    (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))).collect()
}

fn surroundings(
    session: &Session,
    request: &GenerateRequest,
    frames: &[Luminance],
) -> Result<Surroundings, PipelineError> {
    let effects = &request.conditions.effects;
    let is_coupled = effects.iter().any(|applied| applied.effect.id().as_str() == "aps_coupling");
    let aps_starts_us = if is_coupled { driven::aps_starts(session)? } else { Vec::new() };
    let frame_times_us = frames.iter().map(|frame| frame.t_us).collect();
    Ok(Surroundings { aps_starts_us, frame_times_us })
}

fn refuse_what_acts_inside(request: &GenerateRequest) -> Result<(), EffectError> {
    for applied in request.conditions.effects.iter() {
        let enters = applied.effect.acts().enters();
        if (Enters::Memory..=Enters::Emission).contains(&enters) {
            let model = request.parameters.model.model().name();
            return Err(EffectError::NotForModel { id: applied.effect.id(), model });
        }
    }
    Ok(())
}

/// Puts the light behind the effects in place of the frames'.
fn relight(forward: &Forward, drive: &FramesDrive, frames: &mut [Luminance]) {
    let grid = TimeGrid::covering(drive.span_us(), STEP_US);
    let (size, white_dn) = (drive.size(), drive.white_dn());
    for (x, y) in all_pixels(size) {
        let Some(values) = forward.light(drive, x, y, grid) else { continue };
        let curve = SignalCurve::new(grid, values);
        for frame in frames.iter_mut() {
            if let Some(log) = curve.at(frame.t_us as f64) {
                frame.values[size.index(x, y)] = (white_dn * log.exp()) as f32;
            }
        }
    }
}
