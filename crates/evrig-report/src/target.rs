//! Sections on the clocks, the tracks and what the filters dropped.

use super::figure::{Figure, Key, Link, Panel, Sample};
use super::number::count;
use super::page::{Block, Fact, Section};
use super::plot::Ink;
use super::plot::chart::{Axis, Chart, Layer, Stroke};
use super::table::{Cell, Column, Table};
use evrig_analysis::filter::Tally;
use evrig_core::time::Span;
use evrig_reconstruct::clock::{Method, MethodResult, SessionClocks, TimeReference};

/// Time from each frame to the next on both clocks of the Pi.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInterval {
    /// Seconds since the first frame.
    pub at_s: f64,
    /// By SensorTimestamp.
    pub sensor_ms: f64,
    /// By RealTime.
    pub real_ms: f64,
}

/// The picture's path through one camera's frames.
#[derive(Debug, Clone, PartialEq)]
pub struct PicturePath {
    /// Name of the frame stream.
    pub stream: String,
    /// Whether it is the event camera's.
    pub is_davis: bool,
    /// Seconds on the session's time, middle in pixels, side in pixels, turn in degrees; a stretch
    /// without a path holds values that are no numbers.
    pub points: Vec<PathPoint>,
}

/// The picture at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Seconds since the session's beginning.
    pub at_s: f64,
    /// Column and row of the picture's middle.
    pub centre_px: [f64; 2],
    /// Side of the picture.
    pub side_px: f64,
    /// Direction of its bottom edge, clockwise.
    pub angle_deg: f64,
}

/// Points that a figure of single frames draws at most.
const MAX_POINTS: usize = 2_000;

/// What the clocks are and how far they can be trusted.
#[must_use]
pub fn clock_section(clocks: &SessionClocks, intervals: &[FrameInterval]) -> Section {
    let mut blocks = vec![Block::Facts(clock_facts(clocks)), Block::Table(methods(clocks))];
    if !intervals.is_empty() {
        blocks.push(Block::Figure(interval_figure(clocks, intervals)));
    }
    Section {
        title: "Clocks".into(),
        lead: "How the Pi's SensorTimestamp leads to Unix time and to the events' stamps. Every method \
               that the evidence allows was run; the differences below are at the middle of the session."
            .into(),
        blocks,
    }
}

fn clock_facts(clocks: &SessionClocks) -> Vec<Fact> {
    let reference = match clocks.reference {
        TimeReference::Host => "the host's clock",
        TimeReference::PiWall => "the Pi's wall clock, taken for the host's",
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
                "corrects the map by {:.1} ± {:.1} µs (standard error; limit for this motion {:.1} µs)",
                found.correction_us.value, found.correction_us.standard_error, found.cramer_rao_us
            ),
            (None, None) => String::new(),
        };
        facts.push(Fact::new("motion seen by both cameras", words));
    }
    for late in &clocks.stream_delays {
        let words = match (&late.delay_us, &late.refused) {
            (Some(us), _) => format!(
                "its light is {:.0} ± {:.0} µs later than its stamps, which are those of {}",
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
        Method::Hull => "hull",
        Method::Olson2 => "cones both ways",
        Method::Motion => "motion seen by both cameras",
    }
}

fn methods(clocks: &SessionClocks) -> Table {
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
            Cell::text(method(attempt.method)),
            Cell::number(difference.unwrap_or(f64::NAN)),
            Cell::number(width.unwrap_or(f64::NAN)),
            Cell::count(estimate.map_or(0, |estimate| estimate.segments.len() as u64)),
            Cell::text(attempt.refused.as_deref().unwrap_or("")),
        ]
    };
    Table {
        title: "The Pi's wall clock from SensorTimestamp, method by method".into(),
        caption: "The difference is to the first row. A method without an interval claims none."
            .into(),
        columns: vec![
            Column::text("method"),
            Column::number("difference", "µs"),
            Column::number("95\u{a0}% width", "µs"),
            Column::number("segments", ""),
            Column::text("refused because"),
        ],
        rows: clocks.wall.iter().map(row).collect(),
    }
}

/// The published figure: intervals between frames on both clocks, and the frame it takes.
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
        layers.push(Layer::Moment { x: at.at_s, text: "taken".into() });
    }
    let chart = Chart {
        x: Axis::linear("time (s)"),
        y: Axis::linear("interval to the next frame (ms)"),
        layers,
    };
    let n = count(intervals.len() as u64);
    Figure {
        title: "Interval convergence".into(),
        caption: "Time from each frame to the next by SensorTimestamp and by RealTime. The published method \
                  takes the frame where the two are nearest to equal and calls their difference there the \
                  offset; it finds two equal latencies, not a small one."
            .into(),
        legend: vec![
            Key::new(Ink::Real, Sample::Line, "SensorTimestamp"),
            Key::new(Ink::Simulated, Sample::Dot, "RealTime"),
        ],
        panels: vec![Panel {
            title: "Intervals".into(),
            note: format!("{n} intervals"),
            alt: format!("{n} intervals between frames by both clocks of the Pi."),
            drawing: chart.draw_wide(),
        }],
        data: Some(Link::beside("derived/sync/frames.npz")),
    }
}

/// Where the picture was in each camera's frames.
#[must_use]
pub fn track_section(paths: &[PicturePath], facts: Vec<Fact>) -> Section {
    let davis = |ink: bool| if ink { Ink::Real } else { Ink::Simulated };
    let line = |path: &PicturePath, point: &dyn Fn(&PathPoint) -> [f64; 2]| Layer::Line {
        ink: davis(path.is_davis),
        stroke: Stroke::Solid,
        points: path
            .points
            .iter()
            .step_by(path.points.len().div_ceil(MAX_POINTS).max(1))
            .map(point)
            .collect(),
    };
    let middle = |path: &PicturePath| -> [f64; 2] {
        let seen: Vec<&PathPoint> = path.points.iter().filter(|p| p.side_px.is_finite()).collect();
        let mean = |axis: usize| {
            seen.iter().map(|p| p.centre_px[axis]).sum::<f64>() / seen.len().max(1) as f64
        };
        [mean(0), mean(1)]
    };
    let along = paths.iter().map(|path| {
        let [x, y] = middle(path);
        line(path, &move |p| [(p.centre_px[0] - x) / p.side_px, (y - p.centre_px[1]) / p.side_px])
    });
    let turn = paths.iter().map(|path| line(path, &|p| [p.at_s, p.angle_deg]));
    let chart = |x: &str, y: &str, layers| Chart { x: Axis::linear(x), y: Axis::linear(y), layers };
    let centre = chart("right (picture sides)", "up (picture sides)", along.collect());
    let angle = chart("time (s)", "turn (degrees)", turn.collect());
    let names: Vec<&str> = paths.iter().map(|path| path.stream.as_str()).collect();
    let names = names.join(", ");
    let figure = Figure {
        title: "The picture's path".into(),
        caption: "The middle of the tracked picture about its own mean, in sides of the picture so that \
                  cameras of different scale lie on one another, and the turn of its bottom edge over time."
            .into(),
        legend: paths
            .iter()
            .map(|path| Key::new(davis(path.is_davis), Sample::Line, &path.stream))
            .collect(),
        panels: vec![
            Panel {
                title: "Trajectory".into(),
                note: String::new(),
                alt: format!("Path of the picture's middle as seen in {names}."),
                drawing: centre.draw_half(),
            },
            Panel {
                title: "Turn".into(),
                note: String::new(),
                alt: format!("Turn of the picture over time as seen in {names}."),
                drawing: angle.draw_half(),
            },
        ],
        data: None,
    };
    Section {
        title: "Tracking".into(),
        lead: "The tag followed through the frames; the picture's region follows from it.".into(),
        blocks: vec![Block::Figure(figure), Block::Facts(facts)],
    }
}

/// What the filters dropped of each stream.
#[must_use]
pub fn filter_section(streams: &[(String, Tally)]) -> Section {
    let reasons: std::collections::BTreeSet<_> =
        streams.iter().flat_map(|(_, tally)| tally.dropped.keys().copied()).collect();
    let mut columns =
        vec![Column::text("stream"), Column::number("seen", ""), Column::number("kept", "")];
    for reason in &reasons {
        let json = serde_json::to_value(reason).unwrap_or_default();
        columns.push(Column::number(&json.as_str().unwrap_or_default().replace('_', " "), ""));
    }
    let row = |(name, tally): &(String, Tally)| {
        let mut cells = vec![Cell::text(name), Cell::count(tally.seen), Cell::count(tally.kept)];
        let dropped = |reason| tally.dropped.get(reason).copied().unwrap_or(0);
        cells.extend(reasons.iter().map(|reason| Cell::count(dropped(reason))));
        cells
    };
    Section {
        title: "Filters".into(),
        lead: "The same filters with the same settings over real and simulated events.".into(),
        blocks: vec![Block::Table(Table {
            title: "Events kept and dropped, by reason".into(),
            caption: "Every event has a fate: seen is kept and all dropped together.".into(),
            columns,
            rows: streams.iter().map(row).collect(),
        })],
    }
}
