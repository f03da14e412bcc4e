//! Thresholds that differ from pixel to pixel.

use super::{Candidate, EffectId, Hypothesis, Mixture, PLAIN, Parameter};
use crate::diagnose::mixture::Steps;

/// Thresholds from one to the next, standard deviations. A pixel's events tell its thresholds within a
/// fraction of their spread, so that few values far apart would shrink the spread to lie among them.
const STEP: f64 = 1.0 / 32.0;

/// Values on either side of the middle: beyond four standard deviations lies hardly a pixel, and whichever
/// does would stretch the spread of all to have it in.
const N_SIDE: usize = 128;

/// About the middle of their own law.
const OWN: Steps = Steps { middle: 0.0, step: STEP };

/// How far thresholds of one pixel may go together: closer, and values this far apart would not tell.
const MOST_ALIKE: f64 = 0.9;

/// A normal law of two dimensions: a pixel's own comparators set its thresholds for On and Off apart,
/// what they share together.
fn normal(correlation: f64, steps: [Steps; 2]) -> Mixture {
    let spread = 2.0 * (1.0 - correlation * correlation);
    Mixture::even(steps, N_SIDE, |[a, b]| -(a * a - 2.0 * correlation * a * b + b * b) / spread)
}

/// Where thresholds are scored, in standard deviations from the middle of their law.
fn steps(hypothesis: &Hypothesis, index: usize) -> [Steps; 2] {
    let Some(held) = &hypothesis.held else { return [OWN; 2] };
    let law_of = |hypothesis: &Hypothesis| {
        let law = hypothesis.law();
        ([law.theta_on.ln(), law.theta_off.ln()], hypothesis.parameters_of(index)[0])
    };
    let (middles, spread) = law_of(hypothesis);
    let (scored, scored_spread) = law_of(held.other());
    [0, 1].map(|side| Steps {
        middle: (scored[side] - middles[side]) / spread,
        step: STEP * scored_spread / spread,
    })
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
    mixture: Some(|hypothesis, index| {
        normal(hypothesis.parameters_of(index)[1], steps(hypothesis, index))
    }),
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
    use crate::diagnose::Kind;

    #[test]
    fn kinds_have_the_law_that_was_asked_for() {
        for correlation in [-0.5, 0.0, 0.4, 0.9] {
            let kinds = normal(correlation, [OWN; 2]);
            let mean = |of: fn(Kind) -> f64| kinds.kinds().map(|(w, k)| w * of(k)).sum::<f64>();
            assert!((mean(|_| 1.0) - 1.0).abs() < 1e-12 && mean(|k| k[0]).abs() < 1e-12);
            assert!((mean(|k| k[0] * k[0]) - 1.0).abs() < 0.002);
            assert!((mean(|k| k[0] * k[1]) - correlation).abs() < 0.002, "{correlation}");
        }
    }
}
