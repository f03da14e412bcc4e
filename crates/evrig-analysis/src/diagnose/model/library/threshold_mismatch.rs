//! Thresholds that differ between pixels.

use super::{CandidateEffect, CandidateParameter, EffectId, Hypothesis, PLAIN, PixelMixture};
use crate::diagnose::Nuisance;
use crate::diagnose::model::pixel_mixture::GridSpacing;
use crate::diagnose::model::score_grid::HeldGrid;

/// Extent of the grid, standard deviations to either side: few pixels lie beyond, and including
/// them would widen the fitted spread.
const GRID_REACH: f64 = 4.0;

/// Fewest and most grid values to either side. On a coarse grid the fitted spread shrinks towards
/// grid values.
const N_SIDE_RANGE: [usize; 2] = [128, 1024];

/// Grid step in standard deviations of the event-to-event noise: a wider grid biases the spread.
const GRID_STEP_IN_NOISE: f64 = 0.5;

/// Largest ON-OFF correlation that the grid resolves.
const MAX_CORRELATION: f64 = 0.9;

/// Grid values to either side of the center.
fn n_side(hypothesis: &Hypothesis, index: usize) -> usize {
    let [least, most] = N_SIDE_RANGE;
    if !hypothesis.uses_fine_grid {
        return least;
    }
    let step = GRID_STEP_IN_NOISE * hypothesis.nuisance(Nuisance::LogNoise).exp();
    let wanted = GRID_REACH * hypothesis.parameters_of(index)[0] / step;
    (wanted.min(most as f64) as usize).next_power_of_two().clamp(least, most)
}

/// Thresholds in standard deviations from the center, on the shared grid or an own one. The law is
/// bivariate normal: comparators set ON and OFF thresholds, with a common part.
fn mixture(hypothesis: &Hypothesis, index: usize) -> PixelMixture {
    let law_of = |hypothesis: &Hypothesis| {
        let law = hypothesis.law();
        ([law.theta_on.ln(), law.theta_off.ln()], hypothesis.parameters_of(index)[0])
    };
    let scored = hypothesis.shared_grid.as_ref().map_or(hypothesis, HeldGrid::other);
    let n_side = n_side(scored, index);
    let ((middles, spread), (scored, scored_spread)) = (law_of(hypothesis), law_of(scored));
    let steps = [0, 1].map(|side| GridSpacing {
        middle: (scored[side] - middles[side]) / spread,
        step: GRID_REACH / n_side as f64 * scored_spread / spread,
    });
    PixelMixture::normal_grid(steps, n_side, hypothesis.parameters_of(index)[1])
}

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::ThresholdMismatch,
    equation: "theta_p = theta exp(s e_p), e_p normal, fixed for each pixel; ON and OFF correlate",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008 (2.1 % contrast)",
    parameters: &[
        CandidateParameter::log("sigma_relative", [0.005, 1.0]),
        CandidateParameter::linear("on_off_correlation", [-MAX_CORRELATION, MAX_CORRELATION], 0.02)
            .hidden(),
    ],
    starting_points: |_| vec![vec![0.05_f64.ln(), 0.3], vec![0.15_f64.ln(), 0.3]],
    mixture: Some(mixture),
    apply: |values, [on, off], view| {
        // A leak would resolve thresholds more finely than the grid.
        view.law.noise_at_rest = 1.0;
        view.law.theta_on *= (values[0] * on).exp();
        view.law.theta_off *= (values[0] * off).exp();
    },
    derived: |_, values| vec![("on_off_correlation", values[1])],
    competing: &[EffectId::HotPixels, EffectId::Vignetting, EffectId::ShotNoise],
    separating_recording: "the same path twice: a pixel's own threshold is the same in both",
    describe: |values| {
        format!(
            "thresholds differ between pixels with a standard deviation of {:.0} %",
            values[0] * 100.0
        )
    },
    ..PLAIN
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::PixelStratum;

    #[test]
    fn strata_have_the_requested_moments() {
        let correlations = [-0.5, 0.0, 0.4, 0.9];
        // On finer grids half of the values are summed.
        let sizes = [(128, 1e-12), (256, 1e-6)];
        for (correlation, (n_side, sure)) in correlations.map(|c| sizes.map(|s| (c, s))).concat() {
            let own = GridSpacing { middle: 0.0, step: GRID_REACH / n_side as f64 };
            let mixture = PixelMixture::normal_grid([own; 2], n_side, correlation);
            let mean =
                |of: fn(PixelStratum) -> f64| mixture.strata().map(|(w, k)| w * of(k)).sum::<f64>();
            assert!((mean(|_| 1.0) - 1.0).abs() < sure && mean(|k| k[0]).abs() < 1e-12);
            assert!((mean(|k| k[0] * k[0]) - 1.0).abs() < 0.002);
            assert!((mean(|k| k[0] * k[1]) - correlation).abs() < 0.002, "{correlation}");
        }
    }
}
