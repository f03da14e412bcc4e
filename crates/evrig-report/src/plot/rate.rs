//! Event rate over time, On and Off apart, real and simulated with error bands.

use super::Ink;
use super::chart::{Axis, Chart, Layer, Stroke};
use crate::figure::{Figure, Key, Panel, Sample};
use crate::number::significant;
use evrig_core::stats::Estimate;

/// Rates of one polarity over the same bins of time.
#[derive(Debug, Clone, Copy)]
pub struct RateCurve<'a> {
    /// Real rate in each bin, events per second and pixel.
    pub real: &'a [Estimate],
    /// Simulated rate in each bin, events per second and pixel.
    pub simulated: &'a [Estimate],
}

/// On above Off, over one axis of time. `centres_s` are the middles of the bins in seconds
/// from the start of the window; a curve with fewer values ends early.
#[must_use]
pub fn figure(centres_s: &[f64], on: &RateCurve<'_>, off: &RateCurve<'_>) -> Figure {
    let panel = |name: &str, curve: &RateCurve<'_>| {
        let chart = Chart {
            x: time_axis(centres_s),
            y: Axis::from_zero("rate (events/s per pixel)"),
            layers: layers(centres_s, curve),
        };
        let [real, simulated] = [curve.real, curve.simulated].map(mean);
        Panel {
            title: format!("{name} events"),
            note: format!("mean: real {real}, simulated {simulated}"),
            alt: format!(
                "{name} rate over time: real {real}, simulated {simulated} events per second and pixel on average."
            ),
            drawing: chart.draw_wide(),
        }
    };
    Figure {
        title: "Rate over time".to_owned(),
        caption: "Events per second and pixel; bands are 90\u{a0}% intervals. \
                  Look for peaks that come late or early, for a floor that is too high (noise, leak), \
                  and for peaks that are cut (dead time, bandwidth, a full bus)."
            .to_owned(),
        legend: vec![
            Key::new(Ink::Real, Sample::Line, "real"),
            Key::new(Ink::Simulated, Sample::Line, "simulated"),
        ],
        panels: vec![panel("On", on), panel("Off", off)],
        data: None,
    }
}

/// From the first bin's beginning to the last one's end.
fn time_axis(centres_s: &[f64]) -> Axis {
    let axis = Axis::linear("time (s)");
    match centres_s {
        [first, second, .., last] | [first, second @ last] => {
            let half = 0.5 * (second - first);
            axis.over(first - half, last + half)
        }
        _ => axis,
    }
}

fn layers(centres_s: &[f64], curve: &RateCurve<'_>) -> Vec<Layer> {
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
        let curve = RateCurve { real: &real, simulated: &simulated };
        let figure = figure(&[0.5, 1.5, 2.5], &curve, &curve);
        assert_eq!(figure.panels[0].note, "mean: real 3.00, simulated 1.00");
        assert!(figure.panels[1].drawing.wide().contains("band ink-sim"));
    }
}
