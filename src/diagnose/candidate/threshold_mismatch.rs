//! Thresholds that differ from pixel to pixel.

use super::{Candidate, EffectId, Hypothesis, Kind, Mixture, Nuisance, PLAIN, Parameter};

/// Thresholds from one to the next, standard deviations. A pixel's events tell its thresholds within a
/// fraction of their spread, so that few values far apart would shrink the spread to lie among them.
const STEP: f64 = 1.0 / 32.0;

/// Values on either side of the middle: beyond four standard deviations lies hardly a pixel, and whichever
/// does would stretch the spread of all to have it in.
const N_SIDE: usize = 128;

/// How far thresholds of one pixel may go together: closer, and values this far apart would not tell.
const MOST_ALIKE: f64 = 0.9;

/// A normal law of two dimensions: a pixel's own comparators set its thresholds for On and Off apart,
/// what they share together.
fn normal(correlation: f64) -> Mixture {
    let spread = 2.0 * (1.0 - correlation * correlation);
    Mixture::even(STEP, N_SIDE, |[a, b]| {
        (-(a * a - 2.0 * correlation * a * b + b * b) / spread).exp()
    })
}

/// The law of all thresholds is that of the pixels' own: slopes do not lead there, since the middle and
/// the spread lie along a ridge on which each pixel keeps its threshold.
fn retell(kinds: &[Kind], hypothesis: &mut Hypothesis, at: usize) {
    let n = kinds.len().max(1) as f64;
    let mean = |of: &dyn Fn(&Kind) -> f64| kinds.iter().map(of).sum::<f64>() / n;
    let [on, off] = [0, 1].map(|side| mean(&|kind| kind[side]));
    let variance = mean(&|[a, b]| 0.5 * ((a - on).powi(2) + (b - off).powi(2))).max(1e-6);
    let together = mean(&|[a, b]| (a - on) * (b - off)) / variance;
    let spread = hypothesis.values[at].exp();
    let by = [
        (Nuisance::LogTheta as usize, 0.5 * spread * (on + off)),
        (Nuisance::LogRatio as usize, spread * (on - off)),
        (at, 0.5 * variance.ln()),
        (at + 1, together - hypothesis.values[at + 1]),
    ];
    for (value, by) in by {
        let [low, high] = hypothesis.ranges[value];
        hypothesis.values[value] = (hypothesis.values[value] + by).clamp(low, high);
    }
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
    mixture: Some(|values| normal(values[1])),
    retell: Some(retell),
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
            let kinds = normal(correlation);
            let mean = |of: fn(Kind) -> f64| kinds.kinds().map(|(w, k)| w * of(k)).sum::<f64>();
            assert!((mean(|_| 1.0) - 1.0).abs() < 1e-7 && mean(|k| k[0]).abs() < 1e-12);
            assert!((mean(|k| k[0] * k[0]) - 1.0).abs() < 0.002);
            assert!((mean(|k| k[0] * k[1]) - correlation).abs() < 0.002, "{correlation}");
        }
    }
}
