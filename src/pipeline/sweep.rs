//! A sweep: the same seconds of a session generated with one setting at several values.

use super::error::missing;
use super::generate::with_effects;
use super::interpolation::{between, prepared_luminance};
use super::{GenerateRequest, PipelineError};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_generate::{RowShift, RowTimes, build};
use evrig_report::figure::Figure;
use evrig_report::number::{count, significant};
use evrig_report::page::{Fact, Page, ReportSummary, Section, SectionBlock};
use evrig_report::plot::{cloud, heat};
use evrig_session::{Session, StreamKind};

/// What to go through.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepRequest {
    /// What is turned.
    pub name: String,
    /// Its values with the generation at each; all from the same frames.
    pub steps: Vec<(f64, GenerateRequest)>,
    /// Seconds of the session that are generated.
    pub seconds: f64,
}

/// The page and its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Swept {
    /// One self-contained HTML file.
    pub html: String,
    /// Value and number of events of each step.
    pub n_events: Vec<(f64, usize)>,
    /// First and last frame, µs.
    pub window_us: [i64; 2],
}

/// The shortest slice of time that a point cloud shows, µs.
const CLOUD_US: i64 = 100_000;

/// Goes through the steps; `done` is called after each.
///
/// # Errors
/// When the frames cannot be read, a step cannot be generated, or the page cannot be set.
pub fn sweep(
    session: &Session,
    request: &SweepRequest,
    done: &mut dyn FnMut(),
) -> Result<Swept, PipelineError> {
    let Some((_, first)) = request.steps.first() else {
        return Err(missing(session, "a sweep has at least one value".into()));
    };
    let (frames, rows) = frames(session, first, request.seconds)?;
    let size = frames[0].size;
    let window_us = [frames[0].t_us, frames[frames.len() - 1].t_us];
    let real = match session.stream(StreamKind::Events, "real") {
        Ok(entry) if entry.size == Some(size) => {
            let (events, _) = session.events("real")?;
            Some(events.as_slice().between(window_us[0], window_us[1]).iter().collect::<Events>())
        }
        _ => None,
    };
    let mut streams: Vec<(String, Events)> =
        real.map(|events| ("Real".to_owned(), events)).into_iter().collect();
    let mut n_events = Vec::new();
    for (value, step) in &request.steps {
        let events = events(session, step, &frames, rows)?;
        n_events.push((*value, events.len()));
        streams.push((format!("{} = {}", request.name, significant(*value, 3)), events));
        done();
    }
    let page = page(session, request, size, window_us, &streams)?;
    Ok(Swept { html: page.to_html()?, n_events, window_us })
}

/// The frames about the middle of the session, and when their rows were exposed.
fn frames(
    session: &Session,
    request: &GenerateRequest,
    seconds: f64,
) -> Result<(Vec<Luminance>, RowTimes), PipelineError> {
    let entry = session.stream(StreamKind::Frames, &request.from)?;
    let [first, last] = match (entry.first_us, entry.last_us) {
        (Some(first), Some(last)) => [first, last],
        _ => [i64::MIN, i64::MAX],
    };
    let span_us = (seconds * 1e6) as i64;
    let start = (first / 2 + last / 2 - span_us / 2).max(first);
    let mut light = prepared_luminance(session, &request.from, &request.conditions)?;
    let mut found: Vec<Luminance> = Vec::new();
    for frame in light.by_ref() {
        let frame = frame?;
        // A stream on another clock states times that do not compare: it is taken from its start.
        let is_before = session.is_from_pi(&request.from).is_ok_and(|pi| !pi) && frame.t_us < start;
        if is_before {
            continue;
        }
        if found.first().is_some_and(|first| frame.t_us - first.t_us > span_us) {
            break;
        }
        found.push(frame);
    }
    match found.as_slice() {
        [first, _, ..] => {
            let rows = light.rows(first.size);
            Ok((found, rows))
        }
        _ => {
            let what = format!("fewer than two frames of `{}` in {seconds} s", request.from);
            Err(missing(session, what))
        }
    }
}

fn events(
    session: &Session,
    request: &GenerateRequest,
    frames: &[Luminance],
    rows: RowTimes,
) -> Result<Events, PipelineError> {
    if !request.conditions.effects.is_empty() {
        return with_effects(session, request, frames.to_vec(), rows);
    }
    let mut generator = build(&request.parameters, None)?;
    let mut between = between(session, &request.from, &request.conditions)?;
    between.set_rows(rows);
    let rows = if between.is_of_one_instant() { RowTimes::default() } else { rows };
    let (mut shift, mut made, mut events) = (RowShift::default(), Events::new(), Events::new());
    for frame in frames {
        made.clear();
        let (t_us, size) = (frame.t_us, frame.size);
        let pushed = between.push(frame.clone(), |frame| generator.push(frame, &mut made));
        pushed.map_err(|source| PipelineError::Generate {
            session: session.root().to_owned(),
            stream: request.from.clone(),
            source,
        })?;
        shift.push(rows, size, t_us, &made, &mut events);
    }
    shift.finish(&mut events);
    Ok(events)
}

fn page(
    session: &Session,
    request: &SweepRequest,
    size: Size,
    window_us: [i64; 2],
    streams: &[(String, Events)],
) -> Result<Page, PipelineError> {
    let counts: Vec<(String, Vec<u32>)> =
        streams.iter().map(|(title, events)| (title.clone(), counts(size, events))).collect();
    let maps: Vec<(String, &[u32])> =
        counts.iter().map(|(title, counts)| (title.clone(), counts.as_slice())).collect();
    let maps = Figure {
        title: "Events per pixel".to_owned(),
        caption: "All maps share one colour scale.".to_owned(),
        legend: vec![],
        panels: heat::counts_panels(size, &maps).map_err(PipelineError::Image)?,
        data: None,
    };
    let middle = window_us[0] + (window_us[1] - window_us[0]) / 2;
    let shown = [middle, (middle + CLOUD_US).min(window_us[1])];
    let clouds: Vec<_> =
        streams.iter().map(|(title, events)| (title.clone(), events.as_slice())).collect();
    let (panels, thinned) = cloud::panels(size, shown, &clouds);
    let clouds = Figure {
        title: "Events in space and time".to_owned(),
        caption: format!("{thinned}All clouds show the same moment from the same point of view."),
        legend: cloud::legend(),
        panels,
        data: None,
    };
    let numbers =
        streams.iter().map(|(title, events)| Fact::new(title, count(events.len() as u64)));
    let section = |title: &str, lead: &str, blocks| Section {
        title: title.to_owned(),
        lead: lead.to_owned(),
        blocks,
    };
    let name = &request.name;
    Ok(Page {
        title: session.manifest().name.clone(),
        kind: format!("Sweep of {name}"),
        summary: ReportSummary {
            headline: format!("What {name} does to the events"),
            remarks: vec![format!("Nothing but {name} differs between the panels.")],
            facts: numbers.collect(),
            figures: Vec::new(),
        },
        sections: vec![
            section("Where", "How many events each pixel made.", vec![SectionBlock::Figure(maps)]),
            section(
                "When",
                "A tenth of a second, event by event.",
                vec![SectionBlock::Figure(clouds)],
            ),
        ],
        is_folded: false,
        provenance: vec![
            Fact::new("light", request.steps[0].1.from.as_str()),
            Fact::new("window (us)", format!("{} to {}", window_us[0], window_us[1])),
            Fact::new("seed", request.steps[0].1.parameters.seed.to_string()),
            Fact::new("evrig", env!("CARGO_PKG_VERSION")),
        ],
    })
}

fn counts(size: Size, events: &Events) -> Vec<u32> {
    let mut counts = vec![0; size.n_pixels()];
    for event in events.as_slice().iter().filter(|event| size.contains(event.x, event.y)) {
        counts[size.index(event.x, event.y)] += 1;
    }
    counts
}
