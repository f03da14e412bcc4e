//! Generation from frames with physical effects, pixel by pixel; all frames are held in memory.

use super::output::{GenerateTally, all_pixels, failed, open, too_few};
use super::request::GenerateRequest;
use crate::pipeline::PipelineError;
use crate::pipeline::error::missing;
use crate::pipeline::interpolation::between;
use crate::pipeline::luminance::{LuminanceStream, aps_starts};
use evrig_core::drive::{Drive, SignalCurve, TimeGrid};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_generate::effect::{EffectError, RecordingContext, SignalStage};
use evrig_generate::forward::{ForwardError, ForwardParameters, ForwardSimulator};
use evrig_generate::voltmeter::Coefficients;
use evrig_generate::{ModelParameters, RowTimes, VoltmeterLaw, build};
use evrig_reconstruct::scene::FramesDrive;
use evrig_session::Session;
use std::time::{Duration, Instant};

/// Memory budget of the frames, bytes; they are held twice, as luminance and as log intensity.
const MAX_FRAME_BYTES: usize = 3 << 30;

/// Sampling step of the log-intensity signal, µs.
const SIGNAL_STEP_US: u32 = 1_000;

pub(super) fn run(
    session: &Session,
    request: &GenerateRequest,
    luminance: &mut LuminanceStream,
    n_frames: u64,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    let mut frames: Vec<Luminance> = Vec::new();
    for frame in luminance.by_ref() {
        let frame = frame?;
        let bytes = frame.size.n_pixels() * 8 * (frames.len() + 1);
        if bytes > MAX_FRAME_BYTES {
            let what = format!(
                "the frames of `{}` take more than {} GB; effects need them all at once: cut the \
                 session, or leave the effects out",
                request.from,
                MAX_FRAME_BYTES >> 30
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
        n_frames_not_later: luminance.n_not_later(),
        first_us: first.t_us,
        last_us: last.t_us,
        n_pixels: first.size.n_pixels() as u64,
        ..GenerateTally::default()
    };
    let size = first.size;
    let rows = luminance.rows(size);
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
/// The voltmeter runs on the frames' log-intensity signal. Another model takes frames that the
/// effects before its photoreceptor have changed, and its events pass the readout; effects inside
/// it are refused.
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
        ModelParameters::Voltmeter { law: VoltmeterLaw::Exact, k } => Some(k),
        _ => None,
    };
    let parameters = ForwardParameters {
        k: exact.unwrap_or(Coefficients::DVS346),
        effects: request.conditions.effects.clone(),
        step_us: SIGNAL_STEP_US,
    };
    let forward = ForwardSimulator::new(parameters, surroundings).map_err(wrong)?;
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
    refuse_inner_effects(request).map_err(|source| wrong(source.into()))?;
    apply_to_frames(&forward, &drive, &mut frames);
    drop(drive);
    let mut generator = build(&request.parameters, None)?;
    let mut between = between(session, &request.from, &request.conditions)?;
    let mut events = Events::new();
    for frame in frames {
        let pushed = between.push(frame, |frame| generator.push(frame, &mut events));
        pushed.map_err(|source| failed(session, request, source))?;
    }
    forward.apply_readout(&mut events, size, &pixels, window, seed);
    Ok(events)
}

fn surroundings(
    session: &Session,
    request: &GenerateRequest,
    frames: &[Luminance],
) -> Result<RecordingContext, PipelineError> {
    let effects = &request.conditions.effects;
    let is_coupled = effects.iter().any(|applied| applied.effect.id().as_str() == "aps_coupling");
    let aps_starts_us = if is_coupled { aps_starts(session)? } else { Vec::new() };
    let frame_times_us = frames.iter().map(|frame| frame.t_us).collect();
    Ok(RecordingContext { aps_starts_us, frame_times_us })
}

fn refuse_inner_effects(request: &GenerateRequest) -> Result<(), EffectError> {
    for applied in request.conditions.effects.iter() {
        let enters = applied.effect.model().stage();
        if (SignalStage::Memory..=SignalStage::Emission).contains(&enters) {
            let model = request.parameters.model.model().name();
            return Err(EffectError::NotForModel { id: applied.effect.id(), model });
        }
    }
    Ok(())
}

/// Replaces the frames' luminance by that behind the effects.
fn apply_to_frames(forward: &ForwardSimulator, drive: &FramesDrive, frames: &mut [Luminance]) {
    let grid = TimeGrid::covering(drive.span_us(), SIGNAL_STEP_US);
    let (size, white_dn) = (drive.size(), drive.white_dn());
    for (x, y) in all_pixels(size) {
        let Some(values) = forward.comparator_signal(drive, x, y, grid) else { continue };
        let curve = SignalCurve::new(grid, values);
        for frame in frames.iter_mut() {
            if let Some(log) = curve.at(frame.t_us as f64) {
                frame.values[size.index(x, y)] = (white_dn * log.exp()) as f32;
            }
        }
    }
}
