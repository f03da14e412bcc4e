//! Plots of the camera report.

use crate::figure::{Figure, LegendEntry, LegendMark, Panel};
use crate::plot::chart::{Chart, ChartAxis, Layer, Stroke};
use crate::plot::heat::counts_panels;
use crate::plot::pixel_image::PixelImageError;
use crate::plot::{Drawing, Ink};
use evrig_analysis::camera_report::{
    CameraReport, CouplingBurst, OnsetShape, RateLines, RefractoryOnset, SectionResult,
};

/// Bursts that are drawn; weaker ones are in the text.
const MAX_BURSTS: usize = 4;

/// Points of a spectrum that are drawn; a wider bin shows its highest power.
const MAX_POINTS: usize = 1_000;

/// The figures of a section, by its title.
pub(super) fn of(title: &str, report: &CameraReport) -> Result<Vec<Figure>, PixelImageError> {
    Ok(match title {
        "Pixels" => pixel_map(report)?.into_iter().collect(),
        "Coupling to frames" => bursts(report).into_iter().collect(),
        "Refractory period" => hazards(report).into_iter().collect(),
        "Flicker" => report.rate_lines.known().map(spectrum).into_iter().collect(),
        _ => Vec::new(),
    })
}

fn panel(title: String, note: String, alt: String, drawing: Drawing) -> Panel {
    Panel { title, note, alt, drawing }
}

fn pixel_map(report: &CameraReport) -> Result<Option<Figure>, PixelImageError> {
    let Some(pixels) = report.pixels.known() else { return Ok(None) };
    let maps = [("All events".to_owned(), pixels.counts.as_slice())];
    let mut panels = counts_panels(report.size, &maps)?;
    let axis = |label: &str, max: u16| ChartAxis::linear(label).over(0.0, f64::from(max));
    let place = |[x, y]: [u16; 2]| [f64::from(x), f64::from(report.size.height - 1 - y)];
    let hot = pixels.hot.iter().map(|hot| place([hot.x, hot.y])).collect();
    let silent = pixels.silent.iter().copied().map(place).collect();
    let mut legend = Vec::new();
    if !pixels.hot.is_empty() || !pixels.silent.is_empty() {
        legend.push(LegendEntry::new(Ink::On, LegendMark::Dot, "hot"));
        legend.push(LegendEntry::new(Ink::Off, LegendMark::Dot, "silent"));
        let chart = Chart {
            x: axis("column", report.size.width),
            y: axis("rows from below", report.size.height),
            layers: vec![
                Layer::Points { ink: Ink::On, points: hot },
                Layer::Points { ink: Ink::Off, points: silent },
            ],
        };
        let note = format!("{} hot, {} silent", pixels.hot.len(), pixels.silent.len());
        let alt = format!("Places of the outlying pixels: {note}.");
        panels.push(panel("Hot and silent pixels".into(), note, alt, chart.draw_half()));
    }
    Ok(Some(Figure {
        title: "Events per pixel".into(),
        caption: "Hot pixels have more than four times the events of their second busiest \
            neighbour, in either half of the time."
            .into(),
        legend,
        panels,
        data: None,
    }))
}

fn bursts(report: &CameraReport) -> Option<Figure> {
    let found = report.frame_coupling.known().filter(|found| !found.bursts.is_empty())?;
    Some(Figure {
        title: "Events about the bursts, rows aligned".into(),
        caption:
            "Time since the burst's line: delay after the frame's start plus time per row. Per \
            25 us over all frames."
                .into(),
        legend: vec![
            LegendEntry::new(Ink::On, LegendMark::Line, "ON"),
            LegendEntry::new(Ink::Off, LegendMark::Line, "OFF"),
        ],
        panels: found.bursts.iter().take(MAX_BURSTS).map(burst_panel).collect(),
        data: None,
    })
}

fn burst_panel(burst: &CouplingBurst) -> Panel {
    let mut edges: Vec<f64> = burst.profile.iter().map(|bin| 1e-3 * bin.from_us).collect();
    edges.extend(burst.profile.last().map(|bin| 1e-3 * bin.to_us));
    let steps = |ink, heights| Layer::Steps { ink, edges: edges.clone(), heights };
    let chart = Chart {
        x: ChartAxis::linear("time since the line (ms)"),
        y: ChartAxis::from_zero("events"),
        layers: vec![
            steps(Ink::Off, burst.profile.iter().map(|bin| bin.n_off as f64).collect()),
            steps(Ink::On, burst.profile.iter().map(|bin| bin.n_on as f64).collect()),
        ],
    };
    let title = format!(
        "{}: {:.0} us + {:.2} us per row",
        burst.polarity, burst.delay_us.value, burst.row_us.value
    );
    let note = format!("{:.0} standard errors", burst.z);
    let alt = format!("Histogram of events about a burst of {title}: {note}.");
    panel(title, note, alt, chart.draw_half())
}

fn hazards(report: &CameraReport) -> Option<Figure> {
    let onsets: Vec<&RefractoryOnset> =
        report.refractory.iter().filter_map(SectionResult::known).collect();
    if onsets.is_empty() {
        return None;
    }
    Some(Figure {
        title: "Hazard of the interval".into(),
        caption:
            "Events per second of waiting since the pixel's last event, by the time waited. A \
            refractory period is an interval without events; the marks are where half of the \
            highest hazard is reached."
                .into(),
        legend: Vec::new(),
        panels: onsets.into_iter().map(hazard_panel).collect(),
        data: None,
    })
}

fn hazard_panel(onset: &RefractoryOnset) -> Panel {
    let bins = onset.hazard.iter().filter(|bin| bin.to_us > bin.from_us && bin.from_us > 0.0);
    let errors = bins.clone().filter(|bin| bin.n > 0).map(|bin| {
        let error = bin.hz / (bin.n as f64).sqrt();
        let middle = (bin.from_us * bin.to_us).sqrt();
        [1e-3 * middle, bin.hz, (bin.hz - error).max(0.0), bin.hz + error]
    });
    let line = bins.map(|bin| [1e-3 * (bin.from_us * bin.to_us).sqrt(), bin.hz]);
    let mut layers = vec![
        Layer::Line { ink: Ink::Guide, stroke: Stroke::Solid, points: line.collect() },
        Layer::Errors { ink: Ink::Real, points: errors.collect() },
    ];
    if onset.shape != OnsetShape::Absent {
        let text = format!("{:.2} ms", 1e-3 * onset.period_us.value);
        layers.push(Layer::Moment { x: 1e-3 * onset.period_us.value, text });
    }
    let x = ChartAxis::log("interval (ms)").over(0.05, 33.0);
    let chart = Chart { x, y: ChartAxis::from_zero("hazard (Hz)"), layers };
    let title = format!("{} to {}", onset.after.words(), onset.to);
    let note = format!("{} intervals", crate::number::count(onset.n_intervals));
    let alt = format!("Hazard by interval from {title}: {note}.");
    panel(title, note, alt, chart.draw_half())
}

fn spectrum(found: &RateLines) -> Figure {
    let every = found.spectrum.len().div_ceil(MAX_POINTS).max(1);
    let highest = |bins: &[[f64; 2]]| {
        bins.iter()
            .copied()
            .fold([f64::NAN, 0.0], |best, bin| if bin[1] > best[1] { bin } else { best })
    };
    let points: Vec<[f64; 2]> = found.spectrum.chunks(every).map(highest).collect();
    let mut layers = vec![Layer::Line { ink: Ink::Real, stroke: Stroke::Solid, points }];
    layers.extend(found.lines.iter().map(|line| Layer::Moment {
        x: line.frequency_hz.value,
        text: format!("{:.1} Hz", line.frequency_hz.value),
    }));
    let chart = Chart {
        x: ChartAxis::log("frequency (Hz)"),
        y: ChartAxis::log("power over noise"),
        layers,
    };
    let note = format!("{} lines", found.lines.len());
    let alt = format!("Power spectrum of the event rate relative to its surroundings: {note}.");
    Figure {
        title: "Spectrum of the event rate".into(),
        caption:
            "Power of the whole sensor's rate over the power of its surroundings: about 1 for \
            noise. Harmonics of the frame rate are in the curve and not among the lines."
                .into(),
        legend: Vec::new(),
        panels: vec![panel("Whole sensor".into(), note, alt, chart.draw_wide())],
        data: None,
    }
}
