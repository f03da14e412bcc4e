//! The stage `report`: the results of all stages on one page.

mod preflight;
mod target;

use super::scene_source::{SCENE, is_scene};
use super::{PipelineError, filter, read_calibration, read_comparison, read_diagnosis};
use super::{read_forward_simulation, read_heat};
use evrig_analysis::compare::Comparison;
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_report::page::Fact;
use evrig_report::session::{Compared, page};
use evrig_session::{Session, StreamKind, StreamName, read_stage};

/// The session's report as HTML.
///
/// # Errors
/// When a stream or a result cannot be read.
pub fn report(session: &Session) -> Result<String, PipelineError> {
    let real = match session.stream(StreamKind::Events, "real") {
        Ok(_) => session.events("real")?.0,
        Err(_) => evrig_core::event::Events::new(),
    };
    let imported = session.manifest().streams.iter();
    let mut names: Vec<StreamName> = imported
        .filter(|stream| stream.kind == StreamKind::Events)
        .filter_map(|stream| StreamName::new(&stream.name).ok())
        .collect();
    names.extend(session.generated_names());
    let mut compared = Vec::new();
    for name in names {
        let Some(comparison) = read_comparison(session, &name)? else { continue };
        let (events, cut_real) = events(session, &name, &comparison)?;
        let record = read_stage(&session.layout().derived("generate", Some(&name)));
        let light = record.as_ref().and_then(|r| r.parameters.get("from")?.as_str());
        // The scene has no frames to show.
        let light = light.filter(|light| !is_scene(session, light));
        let (frame, moment_us) = moment(session, light, real.as_slice().t, comparison.window_us)?;
        // A frame lies under the events only where they have its own pixels.
        let frame = frame.filter(|frame| Some(frame.size) == comparison.maps.size);
        let made = record.as_ref().map(|record| made(&name, &record.parameters));
        compared.push(Compared {
            name: name.to_string(),
            comparison,
            events,
            cut_real,
            made: made.unwrap_or_default(),
            frame,
            moment_us,
        });
    }
    let mut calibrated = Vec::new();
    let frames = session.manifest().streams.iter().filter(|s| s.kind == StreamKind::Frames);
    for light in frames.map(|stream| stream.name.as_str()).chain([SCENE]) {
        let Ok(name) = StreamName::new(light) else { continue };
        calibrated.extend(read_calibration(session, &name)?.map(|c| (light.to_owned(), c)));
    }
    let mut page =
        page(session, real.as_slice(), &compared, &calibrated).map_err(PipelineError::Image)?;
    // Results come before the description of the recording.
    if let Some(section) = preflight::section(session)? {
        page.sections.insert(page.sections.len().saturating_sub(1), section);
    }
    page.sections.extend(target::sections(session)?);
    // The answer comes first, then its derivation.
    if let Some(diagnosis) = read_diagnosis(session)? {
        page.sections.insert(
            0,
            evrig_report::diagnosis::section(
                &diagnosis,
                read_forward_simulation(session)?.as_ref(),
                &read_heat(session)?,
            ),
        );
    }
    Ok(page.to_html()?)
}

/// A stream's events as they were compared: cropped to the target, the real ones with them, or
/// whole.
fn events(
    session: &Session,
    name: &StreamName,
    comparison: &Comparison,
) -> Result<(Events, Option<Events>), PipelineError> {
    let simulated = filter::filtered_events(session, name)?;
    let real = filter::filtered_events(session, &StreamName::new("real")?)?;
    let compared = comparison.maps.size;
    match simulated.zip(real) {
        Some(((simulated, size, _), (real, real_size, _)))
            if Some(size) == compared && size == real_size =>
        {
            Ok((simulated, Some(real)))
        }
        _ => Ok((session.events(name.as_str())?.0, None)),
    }
}

fn made(name: &StreamName, parameters: &serde_json::Value) -> Vec<Fact> {
    let generator = parameters.get("generator").or_else(|| parameters.get("camera"));
    let generator = generator.map(ToString::to_string).unwrap_or_default();
    vec![Fact::new(&format!("generator of “{name}”"), generator)]
}

/// The frame interval with the most real events, and the frame at its start; without frames,
/// the busiest fiftieth of the window.
fn moment(
    session: &Session,
    light: Option<&str>,
    real: &[i64],
    window: [i64; 2],
) -> Result<(Option<Luminance>, [i64; 2]), PipelineError> {
    let n_between = |from: i64, to: i64| {
        real.partition_point(|&t| t < to).saturating_sub(real.partition_point(|&t| t < from))
    };
    let Some(light) = light else {
        let step = ((window[1] - window[0]) / 50).max(1);
        let starts = (0..50).map(|i| window[0] + i * step);
        let busiest = starts.max_by_key(|start| n_between(*start, start + step));
        let start = busiest.unwrap_or(window[0]);
        return Ok((None, [start, start + step]));
    };
    let mut best: Option<(usize, Luminance, i64)> = None;
    let mut before: Option<Luminance> = None;
    for frame in super::luminance::luminance(session, light)? {
        let frame = frame?;
        if let Some(before) = before.take() {
            let n = n_between(before.t_us, frame.t_us);
            if best.as_ref().is_none_or(|(most, ..)| n > *most) {
                best = Some((n, before, frame.t_us));
            }
        }
        before = Some(frame);
    }
    Ok(best.map_or((None, window), |(_, frame, end)| {
        let start = frame.t_us;
        (Some(frame), [start, end])
    }))
}
