//! Thresholds that differ from pixel to pixel.

use super::{Candidate, EffectId, Kind, PLAIN, Parameter};

/// Nodes from one to the next, standard deviations. A pixel's events tell its thresholds within a
/// fraction of their spread, so that few nodes far apart would shrink the spread to lie among them.
const STEP: f64 = 0.0625;

/// Nodes on either side of the middle: every eighth is scored.
const N_SIDE: i32 = 48;

/// How far thresholds of one pixel may go together: closer, and nodes this far apart would not tell.
const MOST_ALIKE: f64 = 0.9;

/// A normal law of two dimensions at even steps: a pixel's own comparators set its thresholds for On
/// and Off apart, what they share together.
fn nodes(correlation: f64) -> Vec<(f64, Kind)> {
    let at = |i: i32| f64::from(i) * STEP;
    let spread = 2.0 * (1.0 - correlation * correlation);
    // By the trapezoidal rule, in which the ends count half: it bears that nodes are passed over.
    let end = |a: f64| if a.abs() < at(N_SIDE) { 1.0 } else { 0.5 };
    let density = |[a, b]: Kind| {
        end(a) * end(b) * (-(a * a - 2.0 * correlation * a * b + b * b) / spread).exp()
    };
    let all = || (-N_SIDE..=N_SIDE).flat_map(|i| (-N_SIDE..=N_SIDE).map(move |j| [at(i), at(j)]));
    let sum: f64 = all().map(density).sum();
    all().map(|kind| (density(kind) / sum, kind)).collect()
}

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ThresholdMismatch,
    equation: "theta_p = theta exp(s e_p), e_p normal, fixed for each pixel; On and Off correlate",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008 (2.1 % contrast)",
    parameters: &[
        Parameter::log("sigma_relative", [0.005, 1.0]),
        Parameter::linear("on_off_correlation", [-MOST_ALIKE, MOST_ALIKE], 0.02).hidden(),
    ],
    starts: |_| vec![vec![0.05_f64.ln(), 0.3], vec![0.15_f64.ln(), 0.3]],
    mixture: Some(|values| nodes(values[1])),
    act: |values, [on, off], view| {
        view.law.theta_on *= (values[0] * on).exp();
        view.law.theta_off *= (values[0] * off).exp();
    },
    derived: |_, values| vec![("on_off_correlation", values[1])],
    rivals: &[EffectId::HotPixels, EffectId::Vignetting, EffectId::ShotNoise],
    splitter: "the same path twice: a pixel's own threshold is the same in both",
    says: |values| format!("thresholds differ from pixel to pixel by {:.0} %", values[0] * 100.0),
    ..PLAIN
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_the_law_that_was_asked_for() {
        for correlation in [-0.5, 0.0, 0.4, 0.9] {
            let kinds = nodes(correlation);
            let mean = |of: fn(Kind) -> f64| kinds.iter().map(|(w, k)| w * of(*k)).sum::<f64>();
            assert!((mean(|_| 1.0) - 1.0).abs() < 1e-12 && mean(|k| k[0]).abs() < 1e-12);
            assert!((mean(|k| k[0] * k[0]) - 1.0).abs() < 0.04);
            assert!((mean(|k| k[0] * k[1]) - correlation).abs() < 0.04, "{correlation}");
        }
    }
}
