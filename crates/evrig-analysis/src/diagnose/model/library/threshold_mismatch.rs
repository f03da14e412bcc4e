//! Thresholds that differ from pixel to pixel.

use super::{Candidate, EffectId, Hypothesis, Mixture, PLAIN, Parameter};
use crate::diagnose::Nuisance;
use crate::diagnose::model::pixel_mixture::Steps;
use crate::diagnose::model::score_grid::Held;

/// Thresholds on either side of the middle, standard deviations: beyond lies hardly a pixel, and whichever
/// does would stretch the spread of all to have it in.
const REACH: f64 = 4.0;

/// Values on either side of the middle, at the least and at the most. A pixel's events tell its thresholds
/// within a fraction of their spread, so that few values far apart would shrink the spread to lie among them.
const N_SIDE: [usize; 2] = [128, 1024];

/// From one value to the next, in what a threshold is uncertain by from event to event. Where a camera is
/// all but free of noise its events tell a threshold that much more sharply; values further apart than they
/// tell would set the spread by which pixels happen to lie near one.
const SHARP: f64 = 0.5;

/// How far thresholds of one pixel may go together: closer, and values this far apart would not tell.
const MOST_ALIKE: f64 = 0.9;

/// How many values on either side of the middle are sharp enough, where the score is to be fine.
fn n_side(hypothesis: &Hypothesis, index: usize) -> usize {
    let [least, most] = N_SIDE;
    if !hypothesis.is_fine {
        return least;
    }
    let told = SHARP * hypothesis.nuisance(Nuisance::LogNoise).exp();
    let wanted = REACH * hypothesis.parameters_of(index)[0] / told;
    (wanted.min(most as f64) as usize).next_power_of_two().clamp(least, most)
}

/// Thresholds in standard deviations from the middle of their law: those at which the hypothesis is held to
/// be scored, else its own. The law is a normal one of two dimensions: a pixel's own comparators set its thresholds
/// for On and Off apart, what they share together.
fn mixture(hypothesis: &Hypothesis, index: usize) -> Mixture {
    let law_of = |hypothesis: &Hypothesis| {
        let law = hypothesis.law();
        ([law.theta_on.ln(), law.theta_off.ln()], hypothesis.parameters_of(index)[0])
    };
    let scored = hypothesis.held.as_ref().map_or(hypothesis, Held::other);
    let n_side = n_side(scored, index);
    let ((middles, spread), (scored, scored_spread)) = (law_of(hypothesis), law_of(scored));
    let steps = [0, 1].map(|side| Steps {
        middle: (scored[side] - middles[side]) / spread,
        step: REACH / n_side as f64 * scored_spread / spread,
    });
    Mixture::even(steps, n_side, hypothesis.parameters_of(index)[1])
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
    mixture: Some(mixture),
    act: |values, [on, off], view| {
        // What a leak alone would tell of a threshold is finer than the steps between those that are scored.
        view.law.noise_at_rest = 1.0;
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
        let correlations = [-0.5, 0.0, 0.4, 0.9];
        // Of the finer ones every other tells the sum of all.
        let sizes = [(128, 1e-12), (256, 1e-6)];
        for (correlation, (n_side, sure)) in correlations.map(|c| sizes.map(|s| (c, s))).concat() {
            let own = Steps { middle: 0.0, step: REACH / n_side as f64 };
            let kinds = Mixture::even([own; 2], n_side, correlation);
            let mean = |of: fn(Kind) -> f64| kinds.kinds().map(|(w, k)| w * of(k)).sum::<f64>();
            assert!((mean(|_| 1.0) - 1.0).abs() < sure && mean(|k| k[0]).abs() < 1e-12);
            assert!((mean(|k| k[0] * k[0]) - 1.0).abs() < 0.002);
            assert!((mean(|k| k[0] * k[1]) - correlation).abs() < 0.002, "{correlation}");
        }
    }
}
