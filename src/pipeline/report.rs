//! The stage `report`: the results of all stages on one page.

mod preflight;
mod target;

use super::scene_source::{SCENE, is_scene};
use super::{PipelineError, filter, read_calibration, read_comparison, read_diagnosis};
use super::{read_forward_simulation, read_heat};
use evrig_analysis::compare::Comparison;
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_report::answer::DiagnosisResults;
use evrig_report::page::Fact;
use evrig_report::session::{Compared, page};
use evrig_session::{Session, StreamKind, StreamName, read_stage};

/// The session's report as HTML.
///
/// # Errors
/// When a stream or a result cannot be read.
pub fn report(session: &Session) -> Result<String, PipelineError> {
    report_with(session, &[])
}

/// The same with remarks at its top.
///
/// # Errors
/// As [`report`].
pub fn report_with(session: &Session, remarks: &[String]) -> Result<String, PipelineError> {
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
    let diagnosed = match read_diagnosis(session)? {
        Some(diagnosis) => Some(DiagnosisResults {
            diagnosis,
            run: read_forward_simulation(session)?,
            maps: read_heat(session)?,
        }),
        None => None,
    };
    let mut page = page(session, real.as_slice(), &compared, &calibrated, diagnosed.as_ref())
        .map_err(PipelineError::Image)?;
    page.summary.remarks.splice(0..0, remarks.iter().cloned());
    page.sections.extend(preflight::section(session)?);
    page.sections.extend(target::sections(session)?);
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

/// A typical frame interval of motion, and the frame at its start: that at the third quartile of
/// the intervals by real events, so that neither rest nor a flash is shown. Without frames,
/// the same among fiftieths of the window.
fn moment(
    session: &Session,
    light: Option<&str>,
    real: &[i64],
    window: [i64; 2],
) -> Result<(Option<Luminance>, [i64; 2]), PipelineError> {
    let Some(light) = light else {
        let step = ((window[1] - window[0]) / 50).max(1);
        let starts: Vec<i64> = (0..=50).map(|i| window[0] + i * step).collect();
        let start = typical(&starts, real).map_or(window[0], |at| starts[at]);
        return Ok((None, [start, start + step]));
    };
    let mut starts = Vec::new();
    for frame in super::luminance::luminance(session, light)? {
        starts.push(frame?.t_us);
    }
    let Some(at) = typical(&starts, real) else { return Ok((None, window)) };
    let frame = super::luminance::luminance(session, light)?.nth(at).transpose()?;
    Ok((frame, [starts[at], starts[at + 1]]))
}

/// The interval between `starts` at the third quartile by number of events.
fn typical(starts: &[i64], real: &[i64]) -> Option<usize> {
    let n_before = |t: i64| real.partition_point(|&event| event < t);
    let mut counts: Vec<(usize, usize)> = starts
        .windows(2)
        .enumerate()
        .map(|(at, ends)| (n_before(ends[1]) - n_before(ends[0]), at))
        .collect();
    counts.sort_unstable();
    counts.get(counts.len() * 3 / 4).map(|(_, at)| *at)
}

#[cfg(test)]
mod tests {
    use super::typical;

    #[test]
    fn neither_rest_nor_a_flash_is_typical() {
        let starts: Vec<i64> = (0..=8).map(|k| k * 10).collect();
        // Rest, motion of 3 to 5 events an interval, a flash of 50.
        let per_interval = [0, 0, 3, 4, 5, 50, 4, 3];
        let real: Vec<i64> = (0..8)
            .flat_map(|k| std::iter::repeat_n(k * 10 + 1, per_interval[k as usize]))
            .collect();
        assert_eq!(typical(&starts, &real), Some(4));
        assert_eq!(typical(&[0], &real), None);
    }
}
