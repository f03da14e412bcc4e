//! Mixture of pixel strata: the possible values of a pixel's own parameter and their prior
//! weights.

use super::likelihood_profile::LikelihoodProfile;
use std::iter::StepBy;
use std::ops::Range;

/// A pixel's own value for ON and for OFF events.
pub type PixelStratum = [f64; 2];

/// Scored values to either side of the centre on the coarse grid.
const N_COARSE_SIDE: usize = 8;

/// Typical number of scored values of a continuous parameter.
const TYPICAL_N_SCORED: usize = 18;

/// Values to either side of the centre in a sum over the prior, at most.
const MAX_SUMMED_SIDE: usize = 128;

/// Least prior weight over the greatest: a pixel's events must be able to outweigh it.
const MIN_RELATIVE_WEIGHT: f64 = 1e-12;

/// A likelihood this far below the maximum adds nothing: exp(-36) is below double precision.
const NEGLIGIBLE_NATS: f64 = 36.0;

/// Nodes of the trapezoidal rule over a Gaussian (17 standard deviations above exp(-36)), and nodes
/// over the whole grid.
const MIN_NODES: usize = 17;
const MIN_GRID_NODES: usize = 64;

/// A uniform grid of a continuous value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GridSpacing {
    pub(crate) middle: f64,
    pub(crate) step: f64,
}

/// Joint prior weights of ON and OFF values.
#[derive(Debug, Clone)]
enum StratumWeights {
    /// One row per ON value.
    Table(Vec<f64>),
    /// Weights of a normal law, computed on demand: few pairs are used.
    CorrelatedNormal {
        law: CorrelatedNormal,
        /// Inverse sum of the densities.
        per: f64,
    },
}

/// A bivariate normal law with unit variances.
#[derive(Debug, Clone, Copy)]
struct CorrelatedNormal {
    correlation: f64,
    /// Largest log density on the grid.
    greatest: f64,
}

impl CorrelatedNormal {
    /// Density relative to the largest.
    fn density_of(&self, log: f64) -> f64 {
        (log - self.greatest).exp().max(MIN_RELATIVE_WEIGHT)
    }

    /// Log density without normalization.
    fn log(&self, [a, b]: PixelStratum) -> f64 {
        let r = self.correlation;
        -(a * a - 2.0 * r * a * b + b * b) / (2.0 * (1.0 - r * r))
    }
}

/// The strata with their weights. Given the reference level, a pixel's ON value does not affect
/// its OFF events, so that each value is scored once and not per pair.
#[derive(Debug, Clone)]
pub struct PixelMixture {
    /// Values for ON and OFF, ascending, equally many.
    values: [Vec<f64>; 2],
    weights: StratumWeights,
    /// Stride of the coarse grid; above 1 for a continuous value.
    every: usize,
    /// Profile of the coarse grid.
    profile: LikelihoodProfile,
}

impl PixelMixture {
    /// One stratum with value 0.
    #[must_use]
    pub fn single_stratum() -> Self {
        Self::new([vec![0.0], vec![0.0]], vec![1.0], 1)
    }

    /// A share of the pixels has value 1, the rest 0.
    #[must_use]
    pub fn two_strata(share: f64) -> Self {
        let weights = [1.0 - share, share].map(|share| share.max(MIN_RELATIVE_WEIGHT));
        Self::new([vec![0.0, 1.0], vec![0.0, 1.0]], vec![weights[0], 0.0, 0.0, weights[1]], 1)
    }

    fn new(values: [Vec<f64>; 2], weights: Vec<f64>, every: usize) -> Self {
        let profile = LikelihoodProfile::every_nth(values[0].len(), every);
        Self { values, weights: StratumWeights::Table(weights), every, profile }
    }

    /// A uniform grid of a bivariate normal law. Sums use the trapezoidal rule, ends with half
    /// weight, so that values can be skipped.
    pub(crate) fn normal_grid(steps: [GridSpacing; 2], n_side: usize, correlation: f64) -> Self {
        debug_assert!(n_side.is_multiple_of(N_COARSE_SIDE), "{n_side}");
        let n = 2 * n_side + 1;
        let along = |GridSpacing { middle, step }: GridSpacing| {
            (0..n).map(|i| middle + (i as f64 - n_side as f64) * step).collect()
        };
        let values: [Vec<f64>; 2] = steps.map(along);
        let (every, profile) =
            (n_side / N_COARSE_SIDE, LikelihoodProfile::every_nth(n, n_side / N_COARSE_SIDE));
        // Normalization and maximum from a subset of the values.
        let by = (n_side / MAX_SUMMED_SIDE).max(1);
        let some = || {
            let columns = move |row: usize| (0..n).step_by(by).map(move |column| (row, column));
            (0..n).step_by(by).flat_map(columns)
        };
        let mut law = CorrelatedNormal { correlation, greatest: 0.0 };
        let log = |(row, column): (usize, usize)| law.log([values[0][row], values[1][column]]);
        let mut weights: Vec<f64> = some().map(log).collect();
        law.greatest = weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (share, (row, column)) in weights.iter_mut().zip(some()) {
            *share = end(row, n) * end(column, n) * law.density_of(*share);
        }
        let per = 1.0 / (weights.iter().sum::<f64>() * (by * by) as f64);
        let weights = if by == 1 {
            weights.iter_mut().for_each(|share| *share *= per);
            StratumWeights::Table(weights)
        } else {
            StratumWeights::CorrelatedNormal { law, per }
        };
        Self { values, weights, every, profile }
    }

    /// With all weights computed.
    pub(crate) fn tabulated(mut self) -> Self {
        if let StratumWeights::CorrelatedNormal { .. } = self.weights {
            self.weights = StratumWeights::Table(self.strata().map(|(share, _)| share).collect());
        }
        self
    }

    /// Weight of an ON with an OFF value.
    fn weight(&self, row: usize, column: usize) -> f64 {
        let n = self.n();
        match &self.weights {
            StratumWeights::Table(weights) => weights[row * n + column],
            StratumWeights::CorrelatedNormal { law, per } => {
                let log = law.log([self.values[0][row], self.values[1][column]]);
                end(row, n) * end(column, n) * law.density_of(log) * per
            }
        }
    }

    /// Number of values per polarity.
    pub(crate) fn n(&self) -> usize {
        self.values[0].len()
    }

    /// The ON and the OFF value of an index.
    pub(crate) fn at(&self, i: usize) -> PixelStratum {
        self.values.each_ref().map(|values| values[i])
    }

    /// Whether the values form a grid of a continuous one.
    pub(crate) fn is_continuous(&self) -> bool {
        self.every > 1
    }

    pub(crate) const fn coarse_profile(&self) -> &LikelihoodProfile {
        &self.profile
    }

    /// The value of all pixels, if there is one stratum.
    pub(crate) fn single(&self) -> Option<PixelStratum> {
        (self.n() == 1).then(|| self.at(0))
    }

    /// Strata with their weights.
    pub fn strata(&self) -> impl Iterator<Item = (f64, PixelStratum)> + '_ {
        let n = self.n();
        let stratum = move |i: usize| [self.values[0][i / n], self.values[1][i % n]];
        (0..n * n).map(move |i| (self.weight(i / n, i % n), stratum(i)))
    }

    /// The stratum at a quantile in 0..1.
    #[must_use]
    pub fn draw(&self, mut uniform: f64) -> PixelStratum {
        let is_last = |(share, _): &(f64, PixelStratum)| {
            uniform -= share;
            uniform <= 0.0
        };
        self.strata().find(is_last).map_or(self.at(0), |(_, stratum)| stratum)
    }

    /// Typical number of evaluations per pixel.
    pub(crate) fn n_scored(&self) -> usize {
        if self.is_continuous() { TYPICAL_N_SCORED } else { self.n() }
    }

    /// Log-likelihood of a pixel from the ON and OFF log-likelihoods per value.
    pub(crate) fn ln_likelihood(&self, logs: &[Vec<f64>; 2]) -> f64 {
        let [on, off] =
            logs.each_ref().map(|logs| PolarityLikelihood::of(logs, self.is_continuous()));
        let mut sum = 0.0;
        for (row, weight) in on.at.clone().zip(&on.weights) {
            let columns = off.at.clone().zip(&off.weights);
            sum += weight * columns.map(|(column, w)| self.weight(row, column) * w).sum::<f64>();
        }
        on.most + off.most + sum.max(f64::MIN_POSITIVE).ln()
    }

    /// The stratum with the largest posterior.
    pub(crate) fn most_likely(&self, [on, off]: &[Vec<f64>; 2]) -> PixelStratum {
        let (mut best, mut most) = ([0, 0], f64::NEG_INFINITY);
        let greatest = off.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (row, on) in on.iter().enumerate() {
            // Log weights are negative: most rows can be skipped.
            if on + greatest < most {
                continue;
            }
            for (column, off) in off.iter().enumerate() {
                if on + off < most {
                    continue;
                }
                let likely = on + off + self.weight(row, column).ln();
                if likely >= most {
                    (best, most) = ([row, column], likely);
                }
            }
        }
        [self.values[0][best[0]], self.values[1][best[1]]]
    }
}

/// Weight of a node in the trapezoidal rule.
const fn end(i: usize, n: usize) -> f64 {
    if i == 0 || i == n - 1 { 0.5 } else { 1.0 }
}

/// Likelihood of one polarity over the values.
struct PolarityLikelihood {
    /// Maximum log-likelihood.
    most: f64,
    /// Nodes of the integral.
    at: StepBy<Range<usize>>,
    /// Likelihood relative to the maximum, times the step.
    weights: Vec<f64>,
}

impl PolarityLikelihood {
    /// A smooth likelihood is near Gaussian: the trapezoidal rule needs one node per standard
    /// deviation. Discrete values are all needed, since one polarity may exclude what the other
    /// leaves.
    fn of(logs: &[f64], is_continuous: bool) -> Self {
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let counts = |log: &f64| !is_continuous || *log > most - NEGLIGIBLE_NATS;
        let first = logs.iter().position(counts).unwrap_or(0);
        let end = logs.iter().rposition(counts).map_or(logs.len(), |last| last + 1);
        let widest = if is_continuous {
            (logs.len() / MIN_GRID_NODES).min((end - first) / MIN_NODES)
        } else {
            1
        };
        let step = 1 << widest.max(1).ilog2();
        // Aligned to the first value, so that both ends are among the nodes.
        let at = (first.next_multiple_of(step)..end).step_by(step);
        let weights = at.clone().map(|i| (logs[i] - most).exp() * step as f64).collect();
        Self { most, at, weights }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_nodes_do_not_change_the_integral() {
        let steps = GridSpacing { middle: 0.0, step: 1.0 / 32.0 };
        let kinds = PixelMixture::normal_grid([steps; 2], 128, 0.0);
        let bell = |w: f64, middle: f64| -> Vec<f64> {
            kinds.values[0].iter().map(|v| 7.0 - 0.5 * ((v - middle) / w).powi(2)).collect()
        };
        let mut sparse = 0;
        for w in [0.1, 0.2, 0.35, 0.6, 1.0, 3.0, 1e6] {
            for middle in [-2.6, -0.93, 0.0, 1.71] {
                let [on, off] = [bell(w, middle), bell(0.5, 0.3)];
                let each = |logs: &[f64]| -> f64 {
                    let logs = logs.iter().enumerate();
                    logs.map(|(i, log)| kinds.weight(128, i) * log.exp()).sum()
                };
                let middle_share: f64 = (0..257).map(|i| kinds.weight(128, i)).sum();
                let expected = (each(&on) / middle_share).ln() + (each(&off) / middle_share).ln();
                sparse += PolarityLikelihood::of(&on, true).weights.len();
                let got = kinds.ln_likelihood(&[on, off]);
                assert!((got - expected).abs() < 2e-3, "{w} {middle}: {got} {expected}");
            }
        }
        assert!(sparse < 28 * 55, "{sparse} values for 28 likelihoods");
    }

    impl PixelMixture {
        /// Three values with weights 1/4, 1/2, 1/4, equal or independent for both polarities.
        pub(crate) fn of_three(is_one: bool) -> Self {
            let own = [0.25, 0.5, 0.25];
            let share = |on: usize, off: usize| match (is_one, on == off) {
                (true, true) => own[on],
                (true, false) => 0.0,
                (false, _) => own[on] * own[off],
            };
            let weights = (0..9).map(|at| share(at / 3, at % 3)).collect();
            Self::new([vec![-1.0, 0.0, 1.0], vec![-1.0, 0.0, 1.0]], weights, 1)
        }
    }

    #[test]
    fn the_most_likely_stratum_uses_both_polarities() {
        let logs = [vec![0.0, 2.0, 8.0], vec![8.0, 2.0, 0.0]];
        assert_eq!(PixelMixture::of_three(false).most_likely(&logs), [1.0, -1.0]);
        let [low, high] = [0.1, 0.9].map(|uniform| PixelMixture::of_three(true).draw(uniform));
        assert_eq!((low, high), ([-1.0; 2], [1.0; 2]));
    }

    #[test]
    fn strata_excluded_by_one_polarity_are_still_weighted() {
        let sums = [vec![-60.0, -100.0, 0.0], vec![0.0, -100.0, -50.0]];
        let got = PixelMixture::of_three(true).ln_likelihood(&sums);
        assert!((got - (-50.0 + 0.25_f64.ln())).abs() < 1e-3, "{got}");
    }
}
