//! The report of one session: recording, and comparison of each simulated stream.

mod recorded;

use super::answer::{self, DiagnosisResults};
use super::figure::FileLink;
use super::measure::{MeasureRow, headline};
use super::number::{count, ordinal, significant};
use super::page::{Fact, Page, Section, SectionBlock};
use super::plot::pixel_image::PixelImageError;
use super::plot::{cloud, heat, interval, overlay, rate, ratio};
use super::table::{ReportTable, TableCell, TableColumn};
use super::{calibration, diagnosis};
use evrig_analysis::calibrate::Calibration;
use evrig_analysis::compare::{Comparison, IntervalDensity, Maps, RateBand};
use evrig_core::event::{EventSlice, Events};
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_core::stats::Estimate;
use evrig_session::{Manifest, Session};
use recorded::{facts, losses, simulated};

/// A simulated stream with its comparison and the data of its figures.
#[derive(Debug, Clone)]
pub struct Compared {
    /// Its name.
    pub name: String,
    /// How it compares with the real events.
    pub comparison: Comparison,
    /// Its events, in the coordinates in which it was compared.
    pub events: Events,
    /// The real events in the coordinates of the target image, where these were compared.
    pub cut_real: Option<Events>,
    /// Model, preset, interpolation, seed; empty for streams simulated elsewhere.
    pub made: Vec<Fact>,
    /// The frame at the start of [`Compared::moment_us`].
    pub frame: Option<Luminance>,
    /// A short interval with many events, for the figures.
    pub moment_us: [i64; 2],
}

/// Bound on the events of a point cloud.
const CLOUD_EVENTS: usize = 12_000;

/// The page of a session.
///
/// # Errors
/// A map that does not fit its grid, as in a damaged result directory.
pub fn page(
    session: &Session,
    real: EventSlice<'_>,
    compared: &[Compared],
    calibrated: &[(String, Calibration)],
    diagnosed: Option<&DiagnosisResults>,
) -> Result<Page, PixelImageError> {
    let manifest = session.manifest();
    let measured: Vec<(String, Vec<MeasureRow>)> =
        compared.iter().map(|c| (c.name.clone(), measures(&c.name, &c.comparison))).collect();
    let mut summary = answer::summary(diagnosed, &measured);
    summary.facts = facts(manifest);
    summary.remarks.splice(0..0, simulated(manifest));
    summary.remarks.extend(losses(manifest));
    let mut sections: Vec<Section> = diagnosed.map(diagnosis::section).into_iter().collect();
    for stream in compared {
        sections.push(section(session, real, stream)?);
    }
    sections.push(recording(manifest));
    sections.extend(calibrated.iter().map(|(light, c)| calibration::section(light, c)));
    Ok(Page {
        title: manifest.name.clone(),
        kind: "Session report".into(),
        summary,
        sections,
        is_folded: true,
        provenance: provenance(manifest, compared),
    })
}

fn section(
    session: &Session,
    real: EventSlice<'_>,
    stream: &Compared,
) -> Result<Section, PixelImageError> {
    let comparison = &stream.comparison;
    let folder = format!("derived/compare-{}", stream.name);
    let numbers = || FileLink::beside(&format!("{folder}/comparison.json"));
    let mut blocks = vec![SectionBlock::Measures(measures(&stream.name, &stream.comparison))];
    let [start, end] = comparison.window_us;
    let simulated = stream.events.as_slice().between(start, end);
    let real = stream.cut_real.as_ref().map_or(real, Events::as_slice).between(start, end);
    let maps = &comparison.maps;
    if let Some(size) = maps.size {
        let [from, to] = stream.moment_us;
        blocks.push(SectionBlock::Figure(overlay::figure(&overlay::Overlay {
            size,
            frame: stream.frame.as_ref().map(|frame| frame.values.as_slice()),
            window_us: stream.moment_us,
            origin_us: start,
            real: real.between(from, to),
            simulated: simulated.between(from, to),
        })?));
        blocks.extend(map_figures(size, maps, &folder)?);
    }
    blocks.push(SectionBlock::Figure(rate_figure(comparison).with_data(numbers())));
    blocks.push(SectionBlock::Figure(interval_figure(comparison).with_data(numbers())));
    if let Some(size) = maps.size {
        blocks.push(SectionBlock::Figure(cloud_figure(
            size,
            comparison.window_us,
            real,
            simulated,
        )));
    }
    blocks.push(SectionBlock::ReportTable(fits(comparison)));
    blocks.push(SectionBlock::Facts(more_numbers(comparison)));
    Ok(Section {
        title: format!("Generated stream “{}” against the recorded events", stream.name),
        lead: format!(
            "{} {} recorded and {} generated events in {:.3} s on {} pixels of {}. Errors are from a \
             cluster bootstrap over time blocks or tiles of pixels.",
            headline(&measures(&stream.name, comparison)),
            count(comparison.n_real),
            count(comparison.n_simulated),
            (end - start) as f64 * 1e-6,
            count(comparison.n_pixels),
            session.manifest().name,
        ),
        blocks,
    })
}

fn map_figures(
    size: Size,
    maps: &Maps,
    folder: &str,
) -> Result<Vec<SectionBlock>, PixelImageError> {
    let both = |on: &[u32], off: &[u32]| -> Vec<u32> {
        on.iter().zip(off).map(|(on, off)| on.saturating_add(*off)).collect()
    };
    let real = both(&maps.real_on, &maps.real_off);
    let simulated = both(&maps.simulated_on, &maps.simulated_off);
    let counts = heat::CountMaps { size, real: &real, simulated: &simulated };
    let data = || FileLink::beside(&format!("{folder}/maps.npz"));
    Ok(vec![
        SectionBlock::Figure(heat::counts_figure(&counts)?.with_data(data())),
        SectionBlock::Figure(ratio::figure(&counts)?.with_data(data())),
    ])
}

fn rate_figure(comparison: &Comparison) -> super::figure::Figure {
    let curve = &comparison.curves.rate;
    let per_pixel = 1.0 / comparison.n_pixels.max(1) as f64;
    let estimates = |band: &RateBand| -> Vec<Estimate> {
        let bins = band.hz.iter().zip(band.low_hz.iter().zip(&band.high_hz));
        bins.map(|(hz, (low, high))| {
            let interval = [low * per_pixel, high * per_pixel];
            Estimate::with_interval(hz * per_pixel, (interval[1] - interval[0]) / 3.29, interval, 1)
        })
        .collect()
    };
    let centres: Vec<f64> =
        (0..curve.real_on.hz.len()).map(|i| (i as f64 + 0.5) * curve.bin_us * 1e-6).collect();
    let [real_on, real_off] = [&curve.real_on, &curve.real_off].map(estimates);
    let [sim_on, sim_off] = [&curve.simulated_on, &curve.simulated_off].map(estimates);
    rate::figure(
        &centres,
        &rate::RatePlot { real: &real_on, simulated: &sim_on },
        &rate::RatePlot { real: &real_off, simulated: &sim_off },
    )
}

/// Density per µs from probability per decade: d(log10 t)/dt = 1 / (t ln 10).
fn interval_figure(comparison: &Comparison) -> super::figure::Figure {
    let curve = &comparison.curves.intervals;
    let centres: Vec<f64> =
        curve.edges_us.windows(2).map(|edges| (edges[0] * edges[1]).sqrt()).collect();
    let per_us = |t: f64| 1.0 / (t * std::f64::consts::LN_10);
    let density = |stream: &IntervalDensity| -> Vec<Estimate> {
        let bins = centres.iter().zip(&stream.per_decade).enumerate();
        bins.map(|(i, (t, value))| {
            let error = stream.standard_error.get(i).copied().unwrap_or(f64::NAN);
            Estimate::normal(value * per_us(*t), error * per_us(*t), stream.n)
        })
        .collect()
    };
    let fit = |stream: &IntervalDensity| -> Vec<[f64; 2]> {
        let Some(fit) = &stream.fit else { return Vec::new() };
        let points = centres.iter().zip(&fit.inverse_gaussian_per_decade);
        points.map(|(t, value)| [*t, value * per_us(*t)]).filter(|p| p[1] > 1e-12).collect()
    };
    let [real, simulated] = [&curve.real, &curve.simulated];
    let [real_density, simulated_density] = [real, simulated].map(density);
    let [real_fit, simulated_fit] = [real, simulated].map(fit);
    let shown = |density_per_us, fit, stream: &IntervalDensity| interval::IntervalPlot {
        density_per_us,
        fit,
        median_us: median(&centres, &stream.per_decade),
    };
    interval::figure(
        &curve.edges_us,
        &shown(&real_density, &real_fit, real),
        &shown(&simulated_density, &simulated_fit, simulated),
    )
}

fn median(centres: &[f64], per_decade: &[f64]) -> f64 {
    let half = per_decade.iter().sum::<f64>() / 2.0;
    let mut reached = 0.0;
    let at = per_decade.iter().position(|value| {
        reached += value;
        reached >= half && half > 0.0
    });
    at.and_then(|i| centres.get(i).copied()).unwrap_or(f64::NAN)
}

fn cloud_figure(
    size: Size,
    window: [i64; 2],
    real: EventSlice<'_>,
    simulated: EventSlice<'_>,
) -> super::figure::Figure {
    // The same factor for both streams, so that densities compare.
    let step = real.len().max(simulated.len()).div_ceil(CLOUD_EVENTS).max(1);
    let thin = |events: EventSlice<'_>| -> Events { events.iter().step_by(step).collect() };
    let (real, simulated) = (thin(real), thin(simulated));
    let mut figure = cloud::figure(&cloud::Clouds {
        size,
        window_us: window,
        real: real.as_slice(),
        simulated: simulated.as_slice(),
    });
    if step > 1 {
        figure.caption += &format!(" Every {} event of each stream is drawn.", ordinal(step));
    }
    figure
}

fn fits(comparison: &Comparison) -> ReportTable {
    let curve = &comparison.curves.intervals;
    let row = |name: &str, stream: &IntervalDensity| {
        let unknown = Estimate::unknown;
        let fit = stream.fit.as_ref();
        vec![
            TableCell::text(name),
            TableCell::count(stream.n),
            TableCell::estimate(&fit.map_or_else(unknown, |fit| fit.mean_us)),
            TableCell::estimate(&fit.map_or_else(unknown, |fit| fit.shape_us)),
            TableCell::estimate(&fit.map_or_else(unknown, |fit| fit.levy_scale_us)),
            TableCell::estimate(
                &fit.map_or_else(unknown, |fit| fit.inverse_gaussian_over_levy_nats),
            ),
        ]
    };
    ReportTable {
        title: "First-passage distributions fitted to the intervals".into(),
        caption: "Inverse Gaussian: mean and shape; Lévy: scale; and the log-likelihood gain of \
            the inverse Gaussian in nats per interval. Pixels differ, so the pooled sample is a \
            mixture and a poor fit does not exclude the distribution."
            .into(),
        columns: vec![
            TableColumn::text("stream"),
            TableColumn::number("intervals", ""),
            TableColumn::number("mean", "µs"),
            TableColumn::number("shape", "µs"),
            TableColumn::number("Lévy scale", "µs"),
            TableColumn::number("gain over Lévy", "nats"),
        ],
        rows: vec![row("recorded", &curve.real), row("generated", &curve.simulated)],
    }
}

fn more_numbers(comparison: &Comparison) -> Vec<Fact> {
    let curves = &comparison.curves;
    let mut facts = vec![
        Fact::new(
            "rate map, root mean square difference",
            format!("{:.3} Hz per pixel", curves.rate_map.rmse_hz),
        ),
        Fact::new(
            "mean recorded rate",
            format!("{} Hz per pixel", significant(curves.rate_map.mean_real_hz, 3)),
        ),
        Fact::new("rate map, correlation", format!("{:.3}", curves.rate_map.correlation)),
    ];
    if let Some(correlation) = &curves.contrast_correlation {
        let name = |stream: &str| format!("signed counts with log-intensity change, {stream}");
        facts.push(Fact::new(&name("recorded"), format!("r = {:.3}", correlation.real)));
        facts.push(Fact::new(&name("generated"), format!("r = {:.3}", correlation.simulated)));
    }
    facts
}

fn recording(manifest: &Manifest) -> Section {
    let row = |stream: &evrig_session::StreamEntry| {
        let first_and_last = stream.first_us.zip(stream.last_us);
        let seconds = first_and_last.map_or(f64::NAN, |(first, last)| (last - first) as f64 * 1e-6);
        vec![
            TableCell::text(&stream.name),
            TableCell::text(&stream.kind.to_string()),
            TableCell::count(stream.count),
            TableCell::number(seconds),
            TableCell::number(stream.count.saturating_sub(1) as f64 / seconds),
            TableCell::text(&stream.size.map_or_else(String::new, |size| size.to_string())),
            TableCell::text(&stream.source),
        ]
    };
    Section {
        title: "Recording".into(),
        lead: "Streams as counted in the files when the session was finished.".into(),
        blocks: vec![SectionBlock::ReportTable(ReportTable {
            title: "Streams".into(),
            caption: String::new(),
            columns: vec![
                TableColumn::text("stream"),
                TableColumn::text("kind"),
                TableColumn::number("count", ""),
                TableColumn::number("duration", "s"),
                TableColumn::number("rate", "1/s"),
                TableColumn::text("grid"),
                TableColumn::text("source"),
            ],
            rows: manifest.streams.iter().map(row).collect(),
        })],
    }
}

/// The measures as table rows.
#[must_use]
pub fn measures(stream: &str, comparison: &Comparison) -> Vec<MeasureRow> {
    let folder = format!("derived/compare-{stream}/comparison.json");
    let row = |measure: &evrig_analysis::compare::Measure| MeasureRow {
        id: measure_id(measure),
        name: measure.name.to_string(),
        formula: measure.formula.to_string(),
        source: measure.source.to_string(),
        unit: if measure.unit == "1" { String::new() } else { measure.unit.to_string() },
        estimate: measure.estimate,
        healthy: measure.healthy,
        real: measure.real,
        simulated: measure.simulated,
        data: Some(FileLink::beside(&folder)),
    };
    comparison.measures.iter().map(row).collect()
}

fn measure_id(measure: &evrig_analysis::compare::Measure) -> String {
    let json = serde_json::to_value(measure.id).unwrap_or_default();
    json.as_str().unwrap_or_default().to_owned()
}

fn provenance(manifest: &Manifest, compared: &[Compared]) -> Vec<Fact> {
    let mut facts = vec![
        Fact::new("evrig", env!("CARGO_PKG_VERSION")),
        Fact::new("session made", &*manifest.created),
    ];
    for (file, entry) in &manifest.files {
        facts.push(Fact::new(
            file,
            format!("{} bytes, SHA-256 {}", count(entry.bytes), entry.sha256),
        ));
    }
    for stream in compared {
        facts.extend(stream.made.iter().cloned());
    }
    facts
}
