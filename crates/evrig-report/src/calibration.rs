//! The calibration section of the page: constants with errors, and the paper's figures.

use super::figure::{Figure, FileLink, LegendEntry, LegendMark, Panel};
use super::number::{count, significant};
use super::page::{Fact, Section, SectionBlock};
use super::plot::Ink;
use super::plot::chart::{Chart, ChartAxis, Layer, Stroke};
use super::table::{ReportTable, TableCell, TableColumn};
use evrig_analysis::calibrate::{Calibration, Constant, PassageLaw, Regressions};

/// The section of a calibration on the frames named `light`.
#[must_use]
pub fn section(light: &str, calibration: &Calibration) -> Section {
    let link = || FileLink::beside(&format!("derived/calibrate-{light}/k.json"));
    let mut blocks = vec![
        SectionBlock::ReportTable(constants(calibration)),
        SectionBlock::ReportTable(candidates(calibration)),
        SectionBlock::Facts(facts(calibration)),
    ];
    if let Some(regressions) = &calibration.regressions {
        let figures = [histograms(regressions), lines(regressions), drift_and_noise(regressions)];
        blocks.extend(figures.map(|figure| SectionBlock::Figure(figure.with_data(link()))));
    }
    if let Some(because) = &calibration.without_regressions {
        blocks.push(SectionBlock::Text(format!(
            "The paper's regressions were not possible: {because}."
        )));
    }
    Section {
        title: format!("Calibration on “{light}”"),
        lead: format!(
            "Constants k of the event model, fitted to the recorded events of {} pixels and evaluated \
             by “{}” on {} held-out pixels. Selected: {}.",
            count(calibration.split.n_train_pixels as u64),
            calibration.objective,
            count(calibration.split.n_held_out_pixels as u64),
            calibration.from,
        ),
        blocks,
    }
}

const UNITS: [&str; 6] = [
    "thresholds per log unit",
    "DN",
    "thresholds √(DN/µs)",
    "thresholds/µs",
    "thresholds/µs/DN",
    "thresholds/√µs",
];

fn constants(calibration: &Calibration) -> ReportTable {
    let interval = |constant: &Constant| {
        let [low, high] = constant.ci95.map(|end| significant(end, 3));
        TableCell::text(&format!("{} ({low} to {high})", significant(constant.estimate.value, 3)))
    };
    let none = || TableCell::text("–");
    let row = |i: usize| {
        let regressions = calibration.regressions.as_ref();
        vec![
            TableCell::text(&format!("k{}", i + 1)),
            TableCell::number(calibration.k.k()[i]),
            interval(&calibration.passages.k[i]),
            regressions.map_or_else(none, |regressions| interval(&regressions.k[i])),
            TableCell::text(UNITS[i]),
        ]
    };
    ReportTable {
        title: "Constants".into(),
        caption: "With 95 % intervals. Passages: estimating equations over whole intervals \
            between events, unbiased under the model; regressions: the paper's procedure, whose \
            bias the intervals do not contain. Effects that the model lacks bias the noise \
            constants."
            .into(),
        columns: vec![
            TableColumn::text("constant"),
            TableColumn::number("selected", ""),
            TableColumn::text("passages"),
            TableColumn::text("regressions"),
            TableColumn::text("unit"),
        ],
        rows: (0..6).map(row).collect(),
    }
}

fn candidates(calibration: &Calibration) -> ReportTable {
    let number = |value: Option<f64>| value.map_or_else(|| TableCell::text("–"), TableCell::number);
    let row = |candidate: &evrig_analysis::calibrate::CandidateConstants| {
        vec![
            TableCell::text(&candidate.name),
            number(candidate.train),
            number(candidate.held_out),
            TableCell::text(&candidate.k.k().map(|k| significant(k, 3)).join(", ")),
        ]
    };
    ReportTable {
        title: "Candidates".into(),
        caption: "Less is better. “score” is minus the log-likelihood in nats per event, time in \
            seconds; “emd” is the paper's normalised transport distance."
            .into(),
        columns: vec![
            TableColumn::text("k from"),
            TableColumn::number("training tiles", ""),
            TableColumn::number("held-out tiles", ""),
            TableColumn::text("k1 to k6"),
        ],
        rows: calibration.candidates.iter().map(row).collect(),
    }
}

fn facts(calibration: &Calibration) -> Vec<Fact> {
    let fit = &calibration.passages;
    let mut facts = vec![
        Fact::new("intervals used", count(fit.n_used)),
        Fact::new("residual variance / model variance", significant(fit.variance_ratio, 3)),
        Fact::new(
            "residuals beyond half a threshold",
            format!("{} %", significant(100.0 * fit.share_far, 2)),
        ),
    ];
    if let Some(regressions) = &calibration.regressions {
        let [low, high] = regressions.agreement.ci95.map(|end| significant(end, 3));
        let value = significant(regressions.agreement.estimate.value, 3);
        facts.push(Fact::new(
            "consistency of the regressions, k1′/k1 (1 when they agree)",
            format!("{value}, 95 % interval {low} to {high}"),
        ));
    }
    facts
}

/// Density of the fitted distribution per decade of the interval.
fn density_per_decade(law: PassageLaw, drift: f64, sigma: f64, t: f64) -> f64 {
    let shape = 1.0 / (sigma * sigma);
    let away = match law {
        PassageLaw::InverseGaussian => {
            let mean = 1.0 / drift.abs();
            shape * (t - mean) * (t - mean) / (2.0 * mean * mean * t)
        }
        PassageLaw::Levy => shape / (2.0 * t),
    };
    let density = (shape / (std::f64::consts::TAU * t.powi(3))).sqrt() * (-away).exp();
    density * t * std::f64::consts::LN_10
}

fn histograms(regressions: &Regressions) -> Figure {
    let panel = |histogram: &evrig_analysis::calibrate::Histogram| {
        let point = regressions.points.get(histogram.point)?;
        let (low, high) = histogram.edges_us.first().zip(histogram.edges_us.last())?;
        let at = |i: i32| low * (high / low).powf(f64::from(i) / 120.0);
        let fit = |t| density_per_decade(point.law, point.drift_per_us, point.sigma_per_sqrt_us, t);
        let chart = Chart {
            x: ChartAxis::log("interval (µs)"),
            y: ChartAxis::from_zero("probability per decade"),
            layers: vec![
                Layer::Steps {
                    ink: Ink::Real,
                    edges: histogram.edges_us.clone(),
                    heights: histogram.per_decade.clone(),
                },
                Layer::Line {
                    ink: Ink::Simulated,
                    stroke: Stroke::Thin,
                    points: (0..=120).map(|i| [at(i), fit(at(i))]).collect(),
                },
            ],
        };
        let law = match point.law {
            PassageLaw::InverseGaussian => "inverse Gaussian",
            PassageLaw::Levy => "Lévy",
        };
        let title = format!(
            "L = {} DN, change {} DN/ms",
            significant(point.mean_dn, 3),
            significant(point.change_dn_per_us * 1e3, 2)
        );
        Some(Panel {
            alt: format!(
                "Histogram of the intervals at {title} with the fitted {law} distribution."
            ),
            title,
            note: format!("{law}, {} intervals", count(point.n as u64)),
            drawing: chart.draw_half(),
        })
    };
    Figure {
        title: "Intervals and fitted first-passage distributions".into(),
        caption: "The fullest bins of brightness and brightness change. A bin mixes pixels of \
            different drift and intervals that began at other brightness, so histograms are wider \
            than a single distribution."
            .into(),
        legend: vec![
            LegendEntry::new(Ink::Real, LegendMark::Line, "intervals"),
            LegendEntry::new(Ink::Simulated, LegendMark::Thin, "fit"),
        ],
        panels: regressions.histograms.iter().filter_map(panel).collect(),
        data: None,
    }
}

fn lines(regressions: &Regressions) -> Figure {
    let points = regressions.points.iter().map(|p| [p.change_dn_per_us, p.drift_per_us]);
    let ends = |mean_dn: f64| {
        let mine = regressions.points.iter().filter(move |p| p.mean_dn == mean_dn);
        mine.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| {
            [a.min(p.change_dn_per_us), b.max(p.change_dn_per_us)]
        })
    };
    let fits = regressions.lines.iter().map(|line| Layer::Line {
        ink: Ink::Simulated,
        stroke: Stroke::Thin,
        points: ends(line.mean_dn).map(|x| [x, line.slope * x + line.intercept_per_us]).to_vec(),
    });
    let [k1, k2] = [0, 1].map(|i| regressions.k[i].estimate.value);
    let inverse: Vec<[f64; 2]> =
        regressions.lines.iter().map(|line| [line.mean_dn, 1.0 / line.slope]).collect();
    let fit = inverse.iter().map(|[mean, _]| [*mean, (mean + k2) / k1]).collect();
    let fit = Layer::Line { ink: Ink::Simulated, stroke: Stroke::Thin, points: fit };
    Figure {
        title: "First and second regression".into(),
        caption:
            "First: in each level of brightness, drift against rate of change; the slopes are a. \
                  Second: 1/a against brightness; its slope is 1/k1, its intercept k2/k1."
                .into(),
        legend: vec![
            LegendEntry::new(Ink::Real, LegendMark::Dot, "bins, levels"),
            LegendEntry::new(Ink::Simulated, LegendMark::Thin, "regression"),
        ],
        panels: vec![
            panel(
                "First regression",
                format!("{} levels", regressions.lines.len()),
                ["change of brightness (DN/µs)", "drift (thresholds/µs)"],
                points.collect(),
                fits,
            ),
            panel(
                "Second regression",
                format!("k1 = {}, k2 = {}", significant(k1, 3), significant(k2, 3)),
                ["mean brightness (DN)", "1/a (DN per threshold)"],
                inverse,
                [fit],
            ),
        ],
        data: None,
    }
}

fn panel(
    title: &str,
    note: String,
    [x, y]: [&str; 2],
    points: Vec<[f64; 2]>,
    fits: impl IntoIterator<Item = Layer>,
) -> Panel {
    let points = [Layer::Points { ink: Ink::Real, points }];
    Panel {
        title: title.to_owned(),
        note,
        alt: format!("{title}: {y} against {x}, points with the regression."),
        drawing: Chart {
            x: ChartAxis::linear(x),
            y: ChartAxis::linear(y),
            layers: points.into_iter().chain(fits).collect(),
        }
        .draw_half(),
    }
}

fn drift_and_noise(regressions: &Regressions) -> Figure {
    let [_, k2, k3, k4, k5, k6] = regressions.k.map(|k| k.estimate.value);
    let k1_prime = regressions.k1_prime.estimate.value;
    let points = &regressions.points;
    let drift: Vec<[f64; 2]> = points
        .iter()
        .map(|p| {
            let c = p.change_dn_per_us / (p.mean_dn + k2);
            [k1_prime * c + k5 * p.mean_dn + k4, p.drift_per_us]
        })
        .collect();
    let shot = |mean: f64| mean.sqrt() / (mean + k2);
    let noise: Vec<[f64; 2]> =
        points.iter().map(|p| [shot(p.mean_dn), p.sigma_per_sqrt_us]).collect();
    let line = |points: &[[f64; 2]], fit: &dyn Fn(f64) -> f64| {
        let ends = points
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[0]), b.max(p[0])]);
        Layer::Line {
            ink: Ink::Simulated,
            stroke: Stroke::Thin,
            points: ends.map(|x| [x, fit(x)]).to_vec(),
        }
    };
    let drift_line = line(&drift, &|x| x);
    let noise_line = line(&noise, &|x| k3 * x + k6);
    Figure {
        title: "Third regression, and the noise".into(),
        caption: "Third: the drift of every bin against k1′c + k5 L + k4; points off the line are \
            residuals. Noise: diffusion against √L/(L + k2); slope k3, intercept k6."
            .into(),
        legend: vec![
            LegendEntry::new(Ink::Real, LegendMark::Dot, "bins"),
            LegendEntry::new(Ink::Simulated, LegendMark::Thin, "regression"),
        ],
        panels: vec![
            panel(
                "Third regression",
                format!("k1′ = {}", significant(k1_prime, 3)),
                ["regressed drift (thresholds/µs)", "drift (thresholds/µs)"],
                drift,
                [drift_line],
            ),
            panel(
                "Noise",
                format!("k3 = {}, k6 = {}", significant(k3, 2), significant(k6, 2)),
                ["√L/(L + k2) (1/√DN)", "diffusion (thresholds/√µs)"],
                noise,
                [noise_line],
            ),
        ],
        data: None,
    }
}
