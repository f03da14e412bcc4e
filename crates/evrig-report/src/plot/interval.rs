//! Densities of the inter-event intervals on logarithmic axes.

use super::Ink;
use super::chart::{Chart, ChartAxis, Layer, Stroke};
use crate::figure::{Figure, LegendEntry, LegendMark, Panel};
use crate::number::significant;
use evrig_core::stats::Estimate;

/// The density of one stream's intervals.
#[derive(Debug, Clone, Copy)]
pub struct IntervalPlot<'a> {
    /// Density in each bin, per µs.
    pub density_per_us: &'a [Estimate],
    /// The fit as interval (µs) and density (per µs); empty without a fit.
    pub fit: &'a [[f64; 2]],
    /// Median interval, µs; NaN without intervals.
    pub median_us: f64,
}

/// Real and simulated densities over the same bins. `edges_us` are the bins' edges in
/// ascending order, one more than densities; empty bins are gaps.
#[must_use]
pub fn figure(edges_us: &[f64], real: &IntervalPlot<'_>, simulated: &IntervalPlot<'_>) -> Figure {
    let centres: Vec<f64> = edges_us.windows(2).map(|e| (e[0] * e[1]).sqrt()).collect();
    let mut layers = Vec::new();
    for (ink, stream) in [(Ink::Simulated, simulated), (Ink::Real, real)] {
        let bins = || centres.iter().zip(stream.density_per_us);
        let band = bins()
            .map(|(x, d)| if d.value > 0.0 { [*x, d.ci90[0], d.ci90[1]] } else { [f64::NAN; 3] });
        let line = bins().map(|(x, d)| [*x, if d.value > 0.0 { d.value } else { f64::NAN }]);
        layers.push(Layer::Band { ink, points: band.collect() });
        layers.push(Layer::Line { ink, stroke: Stroke::Solid, points: line.collect() });
    }
    let y =
        ChartAxis { range: density_range(real, simulated), ..ChartAxis::log("density (1/µs)") };
    for (ink, stream) in [(Ink::Simulated, simulated), (Ink::Real, real)] {
        if !stream.fit.is_empty() {
            layers.push(Layer::Line { ink, stroke: Stroke::Thin, points: stream.fit.to_vec() });
        }
    }
    let mut x = ChartAxis::log("interval (µs)");
    if let (Some(first), Some(last)) = (edges_us.first(), edges_us.last()) {
        x = x.over(*first, *last);
    }
    let [median_real, median_sim] = [real, simulated].map(|s| significant(s.median_us, 3));
    let mut legend = vec![
        LegendEntry::new(Ink::Real, LegendMark::Line, "recorded"),
        LegendEntry::new(Ink::Simulated, LegendMark::Line, "generated"),
    ];
    if !real.fit.is_empty() || !simulated.fit.is_empty() {
        legend.push(LegendEntry::new(Ink::Guide, LegendMark::Thin, "inverse Gaussian fit"));
    }
    Figure {
        title: "Time between a pixel's events".to_owned(),
        caption: "Density of the intervals between consecutive events of one pixel; bands are \
            90\u{a0}% intervals. A sharp lower edge in the recorded events only indicates a \
            refractory period, a peak at the frame interval an interpolation artefact, and a \
            missing tail missing noise."
            .to_owned(),
        legend,
        panels: vec![Panel {
            title: "Interval density".to_owned(),
            note: format!("median: recorded {median_real} µs, generated {median_sim} µs"),
            alt: format!(
                "Densities of the intervals between events on logarithmic axes; median \
                 {median_real} µs recorded, {median_sim} µs generated."
            ),
            drawing: Chart { x, y, layers }.draw_wide(),
        }],
        data: None,
    }
}

/// Range of the histograms, without the tails of the fits.
fn density_range(real: &IntervalPlot<'_>, simulated: &IntervalPlot<'_>) -> Option<[f64; 2]> {
    let values = || {
        let both = real.density_per_us.iter().chain(simulated.density_per_us);
        both.map(|d| d.value).filter(|v| v.is_finite() && *v > 0.0)
    };
    let low = values().min_by(f64::total_cmp)?;
    let high = values().max_by(f64::total_cmp)?;
    Some([low / 2.0, high * 2.0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_bin_is_a_gap_and_a_fit_does_not_stretch_the_axis() {
        let density = [0.1, 0.0, 0.001, 0.0005].map(|v| Estimate::normal(v, v * 0.1, 50));
        let fit = [[1.0, 0.1], [1e4, 1e-30]];
        let stream = IntervalPlot { density_per_us: &density, fit: &fit, median_us: 12.0 };
        let figure = figure(&[1.0, 10.0, 100.0, 1e3, 1e4], &stream, &stream);
        let svg = figure.panels[0].drawing.wide();
        assert!(svg.contains("10⁻³") || svg.contains("10⁻⁴"), "the axis is labelled in decades");
        assert!(!svg.contains("10⁻²⁰"));
        assert_eq!(figure.legend.len(), 3);
    }
}
