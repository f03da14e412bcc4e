//! The stage `generate`: a session's frames become an event stream.

mod diagnosed;
mod external;
mod from_scene;
mod output;
mod request;
mod with_effects;

pub use diagnosed::{By, CameraRequest, generate_diagnosed};
pub use external::{ExternalRequest, ExternalSimulator, generate_external};
pub use output::{GenerateTally, Generated, GenerationSpeed};
pub use request::GenerateRequest;
pub(super) use with_effects::with_effects;

use super::interpolation::{between, prepared_luminance};
use super::scene_source::{self, is_scene};
use super::{Conditions, PipelineError, luminance};
use evrig_core::event::Events;
use evrig_generate::{PhaseLocking, RowShift, RowTimes, build};
use evrig_session::{Session, StreamKind};
use output::{failed, open, refuse_recorded, stage, too_few};
use serde_json::json;
use std::time::{Duration, Instant};

/// Runs the stage, unless its result is fresh. `progress` takes frames done and in all.
///
/// # Errors
/// When there are no such frames, a frame cannot be used, or the disk refuses.
pub fn generate(
    session: &Session,
    request: &GenerateRequest,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Generated, PipelineError> {
    let name = &request.name;
    refuse_recorded(session, name)?;
    let from_scene = is_scene(session, &request.from);
    let n_frames =
        if from_scene { 0 } else { session.stream(StreamKind::Frames, &request.from)?.count };
    let mut parameters = json!({ "from": request.from, "generator": request.parameters });
    // Each row at its own time; before, all had the middle one's.
    parameters["times"] = json!("row");
    if request.conditions != Conditions::default() {
        parameters["conditions"] = json!(request.conditions);
    }
    let inputs = if from_scene {
        scene_source::inputs_of(session)
    } else {
        luminance::inputs_of(session, &request.from)?
    };
    stage(session, name, request.force, inputs, parameters, || {
        if from_scene {
            from_scene::run(session, request, progress)
        } else {
            run(session, request, n_frames, progress)
        }
    })
}

fn run(
    session: &Session,
    request: &GenerateRequest,
    n_frames: u64,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    let conditions = &request.conditions;
    let mut frames = prepared_luminance(session, &request.from, conditions)?;
    if !conditions.effects.is_empty() {
        return with_effects::run(session, request, &mut frames, n_frames, progress);
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
