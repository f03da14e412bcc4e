//! Sections on clocks, tracking and event filters.

use super::figure::{Figure, FileLink, LegendEntry, LegendMark, Panel};
use super::number::count;
use super::page::{Fact, Section, SectionBlock};
use super::plot::Ink;
use super::plot::chart::{Chart, ChartAxis, Layer, Stroke};
use super::table::{ReportTable, TableCell, TableColumn};
use evrig_analysis::filter::DropTally;
use evrig_core::time::Span;
use evrig_reconstruct::clock::{Method, MethodResult, SessionClocks, TimeReference};

/// Time between two frames on both clocks of the Pi.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInterval {
    /// Seconds since the first frame.
    pub at_s: f64,
    /// By SensorTimestamp.
    pub sensor_ms: f64,
    /// By RealTime.
    pub real_ms: f64,
}

/// Path of the target image through one camera's frames.
#[derive(Debug, Clone, PartialEq)]
pub struct ImagePath {
    /// Name of the frame stream.
    pub stream: String,
    /// Whether it is the event camera's.
    pub is_davis: bool,
    /// Ascending in time; NaN where the path is unknown.
    pub points: Vec<ImagePathPoint>,
}

/// The target image at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePathPoint {
    /// Seconds since the session's beginning.
    pub at_s: f64,
    /// Column and row of the image's middle.
    pub centre_px: [f64; 2],
    /// Side of the image.
    pub side_px: f64,
    /// Direction of its bottom edge, clockwise, degrees.
    pub angle_deg: f64,
}

/// Bound on the points of a figure.
const MAX_POINTS: usize = 2_000;

/// The clock section of the page.
#[must_use]
pub fn clock_section(clocks: &SessionClocks, intervals: &[FrameInterval]) -> Section {
    let mut blocks =
        vec![SectionBlock::Facts(clock_facts(clocks)), SectionBlock::ReportTable(methods(clocks))];
    if !intervals.is_empty() {
        blocks.push(SectionBlock::Figure(interval_figure(clocks, intervals)));
    }
    Section {
        title: "Clocks".into(),
        lead: "Maps from the Pi's SensorTimestamp to Unix time and to the event stamps. All \
            applicable methods were run; differences are at the middle of the session."
            .into(),
        blocks,
    }
}

fn clock_facts(clocks: &SessionClocks) -> Vec<Fact> {
    let reference = match clocks.reference {
        TimeReference::Host => "the host's clock",
        TimeReference::PiWall => "the Pi's wall clock, assumed equal to the host's",
    };
    let mut facts = vec![Fact::new("Unix time is", reference)];
    let map = &clocks.davis_from_sensor;
    facts.push(Fact::new("frames to events by", method(map.method)));
    facts.push(Fact::new("steps of the clock", map.n_steps().to_string()));
    if let Some(error) = map.segments.first().and_then(|segment| segment.error) {
        let end = |end: Option<Span>| end.map_or_else(|| "unbounded".into(), |end| end.to_string());
        let [low, high] = error.statistical95;
        facts
            .push(Fact::new("truth minus map, statistical, 95\u{a0}%", format!("{low} to {high}")));
        let [low, high] = error.absolute95.map(end);
        facts.push(Fact::new("truth minus map, absolute, 95\u{a0}%", format!("{low} to {high}")));
    }
    facts.push(Fact::new("events", clocks.events.reason.clone()));
    if let Some(motion) = &clocks.motion {
        let words = match (&motion.estimate, &motion.refused) {
            (_, Some(because)) => format!("not used: {because}"),
            (Some(found), None) => format!(
                "corrects the map by {:.1} ± {:.1} µs (standard error; limit for this motion \
                 {:.1} µs)",
                found.correction_us.value, found.correction_us.standard_error, found.cramer_rao_us
            ),
            (None, None) => String::new(),
        };
        facts.push(Fact::new("motion in both cameras", words));
    }
    for late in &clocks.stream_delays {
        let words = match (&late.delay_us, &late.refused) {
            (Some(us), _) => format!(
                "exposures are {:.0} ± {:.0} µs later than the stamps, which are those of {}",
                us.value, us.standard_error, late.against
            ),
            (None, because) => {
                format!("late, not corrected: {}", because.as_deref().unwrap_or_default())
            }
        };
        facts.push(Fact::new(&late.stream, words));
    }
    facts
}

fn method(method: Method) -> &'static str {
    match method {
        Method::PaperInterval => "interval convergence (published)",
        Method::PaperWindow => "interval convergence over one second",
        Method::ClockPair => "two-sided clock readings",
        Method::Envelope => "smallest latency between steps",
        Method::Hull => "convex hull",
        Method::Olson2 => "two-sided minimum latency (Olson)",
        Method::Motion => "motion in both cameras",
    }
}

fn methods(clocks: &SessionClocks) -> ReportTable {
    let best = clocks.wall.iter().find_map(|attempt| attempt.estimate.as_ref());
    let middle = best.and_then(|best| {
        let (first, last) = (best.segments.first()?.first, best.segments.last()?.last);
        let at = first.as_nanos().midpoint(last.as_nanos());
        Some((best, evrig_core::time::Stamp::from_nanos(at)))
    });
    let row = |attempt: &MethodResult| {
        let estimate = attempt.estimate.as_ref();
        let difference = middle.zip(estimate).and_then(|((best, at), other)| {
            Some((other.map(at)? - best.map(at)?).as_nanos() as f64 * 1e-3)
        });
        let width = middle.zip(estimate).and_then(|((_, at), other)| {
            let [low, high] = other.statistical95(at)?;
            Some((high - low).as_nanos() as f64 * 1e-3)
        });
        vec![
            TableCell::text(method(attempt.method)),
            TableCell::number(difference.unwrap_or(f64::NAN)),
            TableCell::number(width.unwrap_or(f64::NAN)),
            TableCell::count(estimate.map_or(0, |estimate| estimate.segments.len() as u64)),
            TableCell::text(attempt.refused.as_deref().unwrap_or("")),
        ]
    };
    ReportTable {
        title: "The Pi's wall clock from SensorTimestamp, method by method".into(),
        caption: "Differences are relative to the first row. Not every method gives an interval."
            .into(),
        columns: vec![
            TableColumn::text("method"),
            TableColumn::number("difference", "µs"),
            TableColumn::number("95\u{a0}% width", "µs"),
            TableColumn::number("segments", ""),
            TableColumn::text("refused because"),
        ],
        rows: clocks.wall.iter().map(row).collect(),
    }
}

/// The published figure: intervals between frames on both clocks, and the selected frame.
fn interval_figure(clocks: &SessionClocks, intervals: &[FrameInterval]) -> Figure {
    let step = intervals.len().div_ceil(MAX_POINTS).max(1);
    let points = |of: fn(&FrameInterval) -> f64| -> Vec<[f64; 2]> {
        intervals.iter().step_by(step).map(|i| [i.at_s, of(i)]).collect()
    };
    let mut layers = vec![
        Layer::Points { ink: Ink::Simulated, points: points(|i| i.real_ms) },
        Layer::Line { ink: Ink::Real, stroke: Stroke::Solid, points: points(|i| i.sensor_ms) },
    ];
    let published = clocks.wall.iter().filter(|a| a.method == Method::PaperInterval);
    let choice = published.filter_map(|a| a.estimate.as_ref()?.diagnostics.paper).next();
    let at = choice.and_then(|choice| intervals.get(choice.frame as usize));
    if let Some(at) = at {
        layers.push(Layer::Moment { x: at.at_s, text: "selected".into() });
    }
    let chart = Chart {
        x: ChartAxis::linear("time (s)"),
        y: ChartAxis::linear("interval to the next frame (ms)"),
        layers,
    };
    let n = count(intervals.len() as u64);
    Figure {
        title: "Interval convergence".into(),
        caption: "Time from each frame to the next by SensorTimestamp and by RealTime. The \
            published method takes the frame with the most similar intervals and their difference \
            there as the offset; it finds two equal latencies, not a small one."
            .into(),
        legend: vec![
            LegendEntry::new(Ink::Real, LegendMark::Line, "SensorTimestamp"),
            LegendEntry::new(Ink::Simulated, LegendMark::Dot, "RealTime"),
        ],
        panels: vec![Panel {
            title: "Intervals".into(),
            note: format!("{n} intervals"),
            alt: format!("{n} intervals between frames by both clocks of the Pi."),
            drawing: chart.draw_wide(),
        }],
        data: Some(FileLink::beside("derived/sync/frames.npz")),
    }
}

/// Mean of a path's finite points, px.
fn mean_centre(path: &ImagePath) -> [f64; 2] {
    let seen: Vec<&ImagePathPoint> = path.points.iter().filter(|p| p.side_px.is_finite()).collect();
    let mean = |axis: usize| {
        seen.iter().map(|p| p.centre_px[axis]).sum::<f64>() / seen.len().max(1) as f64
    };
    [mean(0), mean(1)]
}

/// The tracking section of the page.
#[must_use]
pub fn track_section(paths: &[ImagePath], facts: Vec<Fact>) -> Section {
    let davis = |ink: bool| if ink { Ink::Real } else { Ink::Simulated };
    let line = |path: &ImagePath, point: &dyn Fn(&ImagePathPoint) -> [f64; 2]| Layer::Line {
        ink: davis(path.is_davis),
        stroke: Stroke::Solid,
        points: path
            .points
            .iter()
            .step_by(path.points.len().div_ceil(MAX_POINTS).max(1))
            .map(point)
            .collect(),
    };
    let along = paths.iter().map(|path| {
        let [x, y] = mean_centre(path);
        line(path, &move |p| [(p.centre_px[0] - x) / p.side_px, (y - p.centre_px[1]) / p.side_px])
    });
    let turn = paths.iter().map(|path| line(path, &|p| [p.at_s, p.angle_deg]));
    let chart = |x: &str, y: &str, layers| Chart {
        x: ChartAxis::linear(x),
        y: ChartAxis::linear(y),
        layers,
    };
    let centre = chart("right (image sides)", "up (image sides)", along.collect());
    let angle = chart("time (s)", "rotation (degrees)", turn.collect());
    let names: Vec<&str> = paths.iter().map(|path| path.stream.as_str()).collect();
    let names = names.join(", ");
    let figure = Figure {
        title: "Path of the target image".into(),
        caption: "Middle of the tracked image relative to its mean, in image sides so that \
            cameras of different scale coincide, and the rotation of its bottom edge over time."
            .into(),
        legend: paths
            .iter()
            .map(|path| LegendEntry::new(davis(path.is_davis), LegendMark::Line, &path.stream))
            .collect(),
        panels: vec![
            Panel {
                title: "Trajectory".into(),
                note: String::new(),
                alt: format!("Path of the image's middle in {names}."),
                drawing: centre.draw_half(),
            },
            Panel {
                title: "Rotation".into(),
                note: String::new(),
                alt: format!("Rotation of the image over time in {names}."),
                drawing: angle.draw_half(),
            },
        ],
        data: None,
    };
    Section {
        title: "Tracking".into(),
        lead: "The tag tracked through the frames, from which the image region follows.".into(),
        blocks: vec![SectionBlock::Figure(figure), SectionBlock::Facts(facts)],
    }
}

/// The filter section of the page.
#[must_use]
pub fn filter_section(streams: &[(String, DropTally)]) -> Section {
    let reasons: std::collections::BTreeSet<_> =
        streams.iter().flat_map(|(_, tally)| tally.dropped.keys().copied()).collect();
    let mut columns = vec![
        TableColumn::text("stream"),
        TableColumn::number("seen", ""),
        TableColumn::number("kept", ""),
    ];
    for reason in &reasons {
        let json = serde_json::to_value(reason).unwrap_or_default();
        columns.push(TableColumn::number(&json.as_str().unwrap_or_default().replace('_', " "), ""));
    }
    let row = |(name, tally): &(String, DropTally)| {
        let mut cells =
            vec![TableCell::text(name), TableCell::count(tally.seen), TableCell::count(tally.kept)];
        let dropped = |reason| tally.dropped.get(reason).copied().unwrap_or(0);
        cells.extend(reasons.iter().map(|reason| TableCell::count(dropped(reason))));
        cells
    };
    Section {
        title: "Filters".into(),
        lead: "The same filters with the same settings over real and simulated events.".into(),
        blocks: vec![SectionBlock::ReportTable(ReportTable {
            title: "Events kept and dropped, by reason".into(),
            caption: "seen = kept + all dropped".into(),
            columns,
            rows: streams.iter().map(row).collect(),
        })],
    }
}
