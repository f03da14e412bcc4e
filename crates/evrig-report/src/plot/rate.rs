//! ON and OFF event rates over time, real and simulated with error bands.

use super::Ink;
use super::chart::{Chart, ChartAxis, Layer, Stroke};
use crate::figure::{Figure, LegendEntry, LegendMark, Panel};
use crate::number::significant;
use evrig_core::stats::Estimate;

/// Rates of one polarity over the same bins of time.
#[derive(Debug, Clone, Copy)]
pub struct RatePlot<'a> {
    /// Real rate in each bin, events per second and pixel.
    pub real: &'a [Estimate],
    /// Simulated rate in each bin, events per second and pixel.
    pub simulated: &'a [Estimate],
}

/// ON above OFF over a common time axis. `centres_s` are the middles of the bins in seconds
/// from the start of the window; shorter curves end early.
#[must_use]
pub fn figure(centres_s: &[f64], on: &RatePlot<'_>, off: &RatePlot<'_>) -> Figure {
    let panel = |name: &str, curve: &RatePlot<'_>| {
        let chart = Chart {
            x: time_axis(centres_s),
            y: ChartAxis::from_zero("rate (events/s per pixel)"),
            layers: layers(centres_s, curve),
        };
        let [real, simulated] = [curve.real, curve.simulated].map(mean);
        Panel {
            title: format!("{name} events"),
            note: format!("mean: recorded {real}, generated {simulated}"),
            alt: format!(
                "{name} rate over time: recorded {real}, generated {simulated} events per second and \
                 pixel on average."
            ),
            drawing: chart.draw_wide(),
        }
    };
    Figure {
        title: "Rate over time".to_owned(),
        caption: "Events per second and pixel; bands are 90\u{a0}% intervals. \
                  Shifted peaks indicate latency, a high floor noise or leak, truncated peaks a \
                  refractory period, limited bandwidth or readout saturation."
            .to_owned(),
        legend: vec![
            LegendEntry::new(Ink::Real, LegendMark::Line, "recorded"),
            LegendEntry::new(Ink::Simulated, LegendMark::Line, "generated"),
        ],
        panels: vec![panel("ON", on), panel("OFF", off)],
        data: None,
    }
}

fn time_axis(centres_s: &[f64]) -> ChartAxis {
    let axis = ChartAxis::linear("time (s)");
    match centres_s {
        [first, second, .., last] | [first, second @ last] => {
            let half = 0.5 * (second - first);
            axis.over(first - half, last + half)
        }
        _ => axis,
    }
}

fn layers(centres_s: &[f64], curve: &RatePlot<'_>) -> Vec<Layer> {
    let band = |ink: Ink, rates: &[Estimate]| {
        let points = centres_s.iter().zip(rates).map(|(t, r)| [*t, r.ci90[0].max(0.0), r.ci90[1]]);
        Layer::Band { ink, points: points.collect() }
    };
    let line = |ink: Ink, rates: &[Estimate]| {
        let points = centres_s.iter().zip(rates).map(|(t, r)| [*t, r.value]).collect();
        Layer::Line { ink, stroke: Stroke::Solid, points }
    };
    vec![
        band(Ink::Simulated, curve.simulated),
        band(Ink::Real, curve.real),
        line(Ink::Simulated, curve.simulated),
        line(Ink::Real, curve.real),
    ]
}

fn mean(rates: &[Estimate]) -> String {
    let known = rates.iter().map(|r| r.value).filter(|v| v.is_finite());
    let moments: evrig_core::stats::Moments = known.collect();
    significant(moments.mean(), 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_note_gives_both_means_and_unknown_bins_do_not_spoil_them() {
        let real =
            [Estimate::normal(2.0, 0.1, 9), Estimate::unknown(), Estimate::normal(4.0, 0.1, 9)];
        let simulated = [Estimate::normal(1.0, 0.1, 9); 3];
        let curve = RatePlot { real: &real, simulated: &simulated };
        let figure = figure(&[0.5, 1.5, 2.5], &curve, &curve);
        assert_eq!(figure.panels[0].note, "mean: recorded 3.00, generated 1.00");
        assert!(figure.panels[1].drawing.wide().contains("band ink-sim"));
    }
}
