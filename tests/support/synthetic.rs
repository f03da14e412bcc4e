//! A synthetic recording for report pages: a disc that moves over a textured wall.

use evrig::event::{Event, Events};
use evrig::geometry::Size;
use evrig::report::figure::{Figure, FileLink, LegendEntry, LegendMark, Panel};
use evrig::report::measure::MeasureRow;
use evrig::report::page::{Fact, Page, ReportSummary, Section, SectionBlock};
use evrig::report::plot::Ink;
use evrig::report::plot::chart::{Chart, ChartAxis, Layer};
use evrig::report::plot::grid::{self, Colours, FirstRow, HeatGrid};
use evrig::report::plot::interval::{self, IntervalPlot};
use evrig::report::plot::rate::{self, RatePlot};
use evrig::report::plot::{cloud, heat, overlay, ratio};
use evrig::report::table::{ReportTable, TableCell, TableColumn};
use evrig::stats::Estimate;

pub(crate) const SIZE: Size = Size::DAVIS346;
const DURATION_US: i64 = 2_000_000;

/// A reproducible xorshift generator.
pub(crate) struct UniformRandom(u64);

impl UniformRandom {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed | 1)
    }

    /// Uniform in 0..1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn centre(t_us: i64) -> [f64; 2] {
    let phase = t_us as f64 * 1e-6 * std::f64::consts::PI;
    [173.0 + 95.0 * phase.cos(), 130.0 + 60.0 * phase.sin()]
}

/// Events on the disc's rim, and noise; `late_us` and `noise` distinguish two cameras.
fn events(seed: u64, per_step: usize, late_us: f64, noise: f64) -> Events {
    let mut random = UniformRandom::new(seed);
    let mut events = Events::new();
    for step in 0..DURATION_US / 1_000 {
        let t = step * 1_000;
        let [x, y] = centre(t);
        let [ahead_x, ahead_y] = centre(t + 1_000);
        let n = per_step as f64 * (0.4 + 0.6 * (t as f64 * 4e-6).sin().powi(2));
        for _ in 0..n as usize {
            let angle = random.uniform() * std::f64::consts::TAU;
            let radius = 38.0 + 1.6 * (random.uniform() - 0.5);
            let along = (ahead_x - x) * angle.cos() + (ahead_y - y) * angle.sin();
            if random.uniform() > along.abs() * 4.0 {
                continue;
            }
            let t = t + (random.uniform() * 1_000.0 + late_us * random.uniform()) as i64;
            let (px, py) = (x + radius * angle.cos(), y + radius * angle.sin());
            events.push(Event { t, x: px as u16, y: py as u16, on: along > 0.0 });
        }
        for _ in 0..(noise * random.uniform()) as usize {
            let [x, y] =
                [SIZE.width, SIZE.height].map(|n| (random.uniform() * f64::from(n)) as u16);
            events.push(Event { t, x, y, on: random.uniform() < 0.6 });
        }
    }
    events.sort_by_time();
    events
}

fn frame(t_us: i64) -> Vec<f32> {
    let [cx, cy] = centre(t_us);
    let pixel = |i: usize| {
        let (x, y) = ((i % 346) as f64, (i / 346) as f64);
        let wall = 90.0 + 30.0 * (x / 23.0).sin() * (y / 17.0).cos() + 20.0 * (x / 346.0);
        let disc = ((x - cx).powi(2) + (y - cy).powi(2)).sqrt() < 38.0;
        (if disc { 200.0 } else { wall }) as f32
    };
    (0..SIZE.n_pixels()).map(pixel).collect()
}

fn counts(events: &Events) -> Vec<u32> {
    let mut counts = vec![0; SIZE.n_pixels()];
    for event in events.as_slice().iter().filter(|e| SIZE.contains(e.x, e.y)) {
        counts[SIZE.index(event.x, event.y)] += 1;
    }
    counts
}

fn rates(events: &Events, on: bool) -> Vec<Estimate> {
    let n_bins = 100;
    let bin_us = DURATION_US / n_bins;
    let bin = |i: i64| {
        let n = events.as_slice().between(i * bin_us, (i + 1) * bin_us);
        let n = n.iter().filter(|e| e.on == on).count() as f64;
        let scale = 1.0 / (bin_us as f64 * 1e-6 * SIZE.n_pixels() as f64);
        Estimate::normal(n * scale, n.sqrt() * scale, n as u64)
    };
    (0..n_bins).map(bin).collect()
}

/// Edges, density with Poisson errors, and the law it was drawn from.
fn density(mean_us: f64, shape_us: f64, dead_us: f64, seed: u64) -> (Vec<Estimate>, Vec<[f64; 2]>) {
    let law = |t: f64| {
        (shape_us / (std::f64::consts::TAU * t.powi(3))).sqrt()
            * (-shape_us * (t - mean_us).powi(2) / (2.0 * mean_us.powi(2) * t)).exp()
    };
    let mut random = UniformRandom::new(seed);
    let edges = edges_us();
    let bins = edges.windows(2).map(|e| {
        let centre = (e[0] * e[1]).sqrt();
        let expected = if centre < dead_us { 0.0 } else { 40_000.0 * law(centre) * (e[1] - e[0]) };
        let n = (expected + expected.sqrt() * (random.uniform() + random.uniform() - 1.0))
            .round()
            .max(0.0);
        let scale = 1.0 / (40_000.0 * (e[1] - e[0]));
        Estimate::normal(n * scale, n.sqrt() * scale, n as u64)
    });
    let fit = (0..120).map(|i| 10_f64.powf(2.0 + 4.0 * f64::from(i) / 119.0));
    (bins.collect(), fit.map(|t| [t, law(t)]).collect())
}

fn edges_us() -> Vec<f64> {
    (0..=60).map(|i| 10_f64.powf(2.0 + 4.0 * f64::from(i) / 60.0)).collect()
}

/// Id, name, formula, value, error, healthy range, the real and the simulated side.
type Row = (&'static str, &'static str, &'static str, f64, f64, Option<[f64; 2]>, Option<[f64; 2]>);

#[rustfmt::skip]
const MEASURES: [Row; 7] = [
    ("count_ratio", "Event count ratio", "N_sim / N_real", 1.313, 0.021, Some([0.5, 2.0]), Some([78_830.0, 103_504.0])),
    ("polarity_delta", "Polarity difference", "|p_sim − p_real|, p = N_on / N", 0.104_3, 0.005_1, Some([0.0, 0.10]), Some([0.512, 0.616_3])),
    ("active_pixel_ratio", "Active pixel ratio", "active_sim / active_real", 1.104, 0.032, Some([0.8, 1.2]), Some([0.421, 0.465])),
    ("spatial_entropy_ratio", "Spatial entropy ratio", "H_sim / H_real, H = −Σ q ln q", 0.968, 0.004, Some([0.8, 1.2]), Some([9.81, 9.50])),
    ("spatial_emd", "Spatial earth mover's distance", "EMD(q_sim, q_real)", 3.42, 0.29, None, None),
    ("interval_tv", "Interval total variation", "½ Σ |h_sim − h_real|, 60 log bins", 0.412, 0.013, Some([0.0, 0.25]), None),
    ("interval_emd", "Interval earth mover's distance", "Sinkhorn divergence of ln Δt, blur 0.05", 0.118, 0.009, None, None),
];

fn measures() -> Vec<MeasureRow> {
    let measure = |(id, name, formula, value, error, healthy, sides): Row| MeasureRow {
        id: id.into(),
        name: name.into(),
        formula: formula.into(),
        source: "Ning et al., Raw2Event".into(),
        unit: if id == "spatial_emd" { "px".into() } else { String::new() },
        estimate: Estimate::normal(value, error, 4_200),
        healthy,
        real: sides.map(|[real, _]| real),
        simulated: sides.map(|[_, simulated]| simulated),
        data: Some(FileLink::beside("derived/compare-aps/measures.json")),
    };
    MEASURES.into_iter().map(measure).collect()
}

fn table() -> ReportTable {
    let mut random = UniformRandom::new(5);
    let rows = (1..=9).map(|i| {
        let [a, b, c] = std::array::from_fn(|_| random.uniform());
        vec![
            TableCell::text(&format!("street-{i}"))
                .with_link(FileLink::beside(&format!("street-{i}/report.html"))),
            TableCell::text(if i % 2 == 0 { "raw" } else { "rgb" }),
            TableCell::count(60_000 + (a * 90_000.0) as u64),
            TableCell::estimate(&Estimate::normal(0.7 + a, 0.02 + 0.03 * b, 900)),
            TableCell::estimate(&Estimate::normal(0.1 + 0.4 * c, 0.004 + 0.01 * a, 900)),
        ]
    });
    ReportTable {
        title: "Sessions".into(),
        caption:
            "One row per session. Check for sessions far from the others before you trust a mean."
                .into(),
        columns: vec![
            TableColumn::text("Session"),
            TableColumn::text("Light"),
            TableColumn::number("Events", ""),
            TableColumn::number("Count ratio", ""),
            TableColumn::number("Interval TV", ""),
        ],
        rows: rows.collect(),
    }
}

fn summary(measures: &[MeasureRow]) -> ReportSummary {
    let mut summary = ReportSummary::from_measures(measures);
    let remark = "The generator fires again within 800 µs of an event; the camera never does.";
    summary.remarks.push(remark.into());
    summary.facts = vec![
        Fact::new("Recorded", "2026-11-21 10:54 UTC"),
        Fact::new("Duration", "2.000 s"),
        Fact::new("Real events", "78 830"),
        Fact::new("Simulated events", "103 504"),
        Fact::new("Sensor", "DAVIS346, 346 × 260"),
        Fact::new("Generator", "voltmeter, aps"),
    ];
    summary
}

fn in_space(real: &Events, simulated: &Events) -> Section {
    let frame = frame(1_000_000);
    let overlay = overlay::Overlay {
        size: SIZE,
        frame: Some(&frame),
        window_us: [990_000, 1_010_000],
        origin_us: 0,
        real: real.as_slice(),
        simulated: simulated.as_slice(),
    };
    let (real, simulated) = (counts(real), counts(simulated));
    let maps = heat::CountMaps { size: SIZE, real: &real, simulated: &simulated };
    let figures = [
        overlay::figure(&overlay).expect("the frame fits"),
        heat::counts_figure(&maps).expect("the maps fit"),
        ratio::figure(&maps).expect("the maps fit"),
    ];
    Section {
        title: "In space".into(),
        lead: "Where the events are.".into(),
        blocks: figures.map(SectionBlock::Figure).into(),
    }
}

fn in_time(real: &Events, simulated: &Events) -> Section {
    let clouds = cloud::Clouds {
        size: SIZE,
        window_us: [900_000, 1_100_000],
        real: real.as_slice(),
        simulated: simulated.as_slice(),
    };
    let centres: Vec<f64> = (0..100).map(|i| 0.01 + 0.02 * f64::from(i)).collect();
    let [on_real, off_real] = [true, false].map(|on| rates(real, on));
    let [on_sim, off_sim] = [true, false].map(|on| rates(simulated, on));
    let on = RatePlot { real: &on_real, simulated: &on_sim };
    let off = RatePlot { real: &off_real, simulated: &off_sim };
    let (density_real, fit_real) = density(21_000.0, 9_000.0, 800.0, 7);
    let (density_sim, fit_sim) = density(14_000.0, 11_000.0, 0.0, 9);
    let intervals = interval::figure(
        &edges_us(),
        &IntervalPlot { density_per_us: &density_real, fit: &fit_real, median_us: 9_100.0 },
        &IntervalPlot { density_per_us: &density_sim, fit: &fit_sim, median_us: 7_400.0 },
    );
    let figures = [
        rate::figure(&centres, &on, &off),
        intervals.with_data(FileLink::beside("derived/compare-aps/intervals.json")),
        cloud::figure(&clouds),
    ];
    Section {
        title: "In time".into(),
        lead: "When the events are.".into(),
        blocks: figures.map(SectionBlock::Figure).into(),
    }
}

/// General plots: points with errors and marks, a histogram and two grids.
fn in_general() -> Section {
    let [clock, histogram] = general_charts();
    let values: Vec<f64> = (0..96)
        .map(|i| {
            if i % 31 == 30 {
                f64::NAN
            } else {
                (f64::from(i % 12) - 5.0) * f64::from(i / 12 - 3) * 0.1
            }
        })
        .collect();
    let sweep = |colours| HeatGrid {
        x: ChartAxis::linear("k1").over(0.0, 6.0),
        y: ChartAxis::linear("k3 (10⁻⁶)").over(1.0, 3.0),
        cells: Size::new(12, 8),
        values: &values,
        first_row: FirstRow::Bottom,
        colours,
        label: "ln count ratio".into(),
    };
    let panel = |title: &str, drawing| Panel {
        title: title.into(),
        note: String::new(),
        alt: format!("{title}."),
        drawing,
    };
    let figure = |title: &str, panels| {
        SectionBlock::Figure(Figure {
            title: title.into(),
            caption: "What these show is made up.".into(),
            legend: vec![
                LegendEntry::new(Ink::Real, LegendMark::Line, "real"),
                LegendEntry::new(Ink::Guide, LegendMark::Area, "error"),
            ],
            panels,
            data: None,
        })
    };
    let pair = vec![
        panel("Clock", clock.draw_half()),
        panel("Tracking", histogram.draw_half()),
        panel("Sweep", grid::draw(&sweep(Colours::Sequential)).expect("the cells fit")),
        panel("Sweep, signed", grid::draw(&sweep(Colours::Diverging(1.0))).expect("the cells fit")),
    ];
    Section {
        title: "In general".into(),
        blocks: vec![figure("Four plots", pair)],
        ..Section::default()
    }
}

fn general_charts() -> [Chart; 2] {
    let mut random = UniformRandom::new(3);
    let residual: Vec<[f64; 4]> = (0..24)
        .map(|i| {
            let (t, value) = (f64::from(i) * 2.5, 40.0 * (random.uniform() - 0.5) + f64::from(i));
            [t, value, value - 12.0, value + 12.0]
        })
        .collect();
    let clock = Chart {
        x: ChartAxis::linear("time (s)"),
        y: ChartAxis::linear("residual of the clock map (µs)"),
        layers: vec![
            Layer::Level { y: 0.0, text: "the map".into() },
            Layer::Moment { x: 31.0, text: "NTP step".into() },
            Layer::Errors { ink: Ink::Real, points: residual },
        ],
    };
    let histogram = Chart {
        x: ChartAxis::linear("track error (px)"),
        y: ChartAxis::from_zero("frames"),
        layers: vec![
            Layer::Steps {
                ink: Ink::Real,
                edges: (0..=12).map(|i| f64::from(i) * 0.1).collect(),
                heights: vec![2.0, 14.0, 40.0, 66.0, 51.0, 30.0, 17.0, 9.0, 4.0, 2.0, 0.0, 1.0],
            },
            Layer::Points { ink: Ink::Simulated, points: vec![[0.35, 60.0], [0.55, 20.0]] },
        ],
    };
    [clock, histogram]
}

/// A page with every kind of block, from synthetic events.
pub(crate) fn page(title: &str) -> Page {
    let (real, simulated) = (events(11, 900, 300.0, 14.0), events(23, 1_250, 2_500.0, 4.0));
    let measures = measures();
    let lead = "Each number compares the simulated events with the real ones over the same pixels \
                and the same window. Errors are standard errors from blocks of time; the verdict \
                follows from the 90 % interval.";
    Page {
        is_folded: false,
        title: title.into(),
        kind: "Session report".into(),
        summary: summary(&measures),
        sections: vec![
            Section {
                title: "Measures".into(),
                lead: lead.into(),
                blocks: vec![SectionBlock::Measures(measures)],
            },
            in_space(&real, &simulated),
            in_time(&real, &simulated),
            in_general(),
            Section {
                blocks: vec![SectionBlock::ReportTable(table())],
                title: "Sessions".into(),
                ..Section::default()
            },
        ],
        provenance: vec![
            Fact::new("Stage", "compare, generate-aps"),
            Fact::new("Seed", "20261121"),
            Fact::new("Events (SHA-256)", "b383462d72122c69…"),
        ],
    }
}
