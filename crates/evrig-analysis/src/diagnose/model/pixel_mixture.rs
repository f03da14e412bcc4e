//! Pixels of several kinds: which there are, and how likely each.

use super::likelihood_profile::LikelihoodProfile;
use std::iter::StepBy;
use std::ops::Range;

/// What a pixel is given for its On events and for its Off events, where pixels are of several kinds.
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

/// Even steps of a continuous value about its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GridSpacing {
    pub(crate) middle: f64,
    pub(crate) step: f64,
}

/// Share of each value for On with each for Off.
#[derive(Debug, Clone)]
enum StratumWeights {
    /// One row for each for On.
    Table(Vec<f64>),
    /// Those of a normal law, worked out where they are asked for: of so many values hardly any pair is.
    CorrelatedNormal {
        law: CorrelatedNormal,
        /// One over what the densities add up to.
        per: f64,
    },
}

/// A normal law of two dimensions, of which both scatter by 1.
#[derive(Debug, Clone, Copy)]
struct CorrelatedNormal {
    correlation: f64,
    /// The greatest logarithm of its density among the values.
    greatest: f64,
}

impl CorrelatedNormal {
    /// Density of that logarithm, over the greatest.
    fn density_of(&self, log: f64) -> f64 {
        (log - self.greatest).exp().max(MIN_RELATIVE_WEIGHT)
    }

    /// Logarithm of the density, of any size.
    fn log(&self, [a, b]: PixelStratum) -> f64 {
        let r = self.correlation;
        -(a * a - 2.0 * r * a * b + b * b) / (2.0 * (1.0 - r * r))
    }
}

/// The kinds of pixel that there are. What a pixel is given for On does not touch its Off events given
/// what it memorised, so that each value is scored once, whatever it is paired with.
#[derive(Debug, Clone)]
pub struct PixelMixture {
    /// Values that a pixel may be given, ascending, as many for On as for Off.
    values: [Vec<f64>; 2],
    weights: StratumWeights,
    /// From one value to the next that a coarse score takes: more than 1 where the values are even steps of
    /// a continuous one.
    every: usize,
    /// The course of a coarse score.
    profile: LikelihoodProfile,
}

impl PixelMixture {
    /// All pixels are alike: they are given 0.
    #[must_use]
    pub fn single_stratum() -> Self {
        Self::new([vec![0.0], vec![0.0]], vec![1.0], 1)
    }

    /// A share of the pixels is given 1, the rest 0.
    #[must_use]
    pub fn two_strata(share: f64) -> Self {
        let weights = [1.0 - share, share].map(|share| share.max(MIN_RELATIVE_WEIGHT));
        Self::new([vec![0.0, 1.0], vec![0.0, 1.0]], vec![weights[0], 0.0, 0.0, weights[1]], 1)
    }

    fn new(values: [Vec<f64>; 2], weights: Vec<f64>, every: usize) -> Self {
        let profile = LikelihoodProfile::every_nth(values[0].len(), every);
        Self { values, weights: StratumWeights::Table(weights), every, profile }
    }

    /// As many even steps to either side of a middle, of a normal law in which both polarities correlate. The sums
    /// over them are by the trapezoidal rule, in which the ends count half: it bears that values are passed
    /// over.
    pub(crate) fn normal_grid(steps: [GridSpacing; 2], n_side: usize, correlation: f64) -> Self {
        debug_assert!(n_side.is_multiple_of(N_COARSE_SIDE), "{n_side}");
        let n = 2 * n_side + 1;
        let along = |GridSpacing { middle, step }: GridSpacing| {
            (0..n).map(|i| middle + (i as f64 - n_side as f64) * step).collect()
        };
        let values: [Vec<f64>; 2] = steps.map(along);
        let (every, profile) =
            (n_side / N_COARSE_SIDE, LikelihoodProfile::every_nth(n, n_side / N_COARSE_SIDE));
        // What all add up to, and which is the greatest, some of them say as well.
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

    /// The same with all shares worked out.
    pub(crate) fn tabulated(mut self) -> Self {
        if let StratumWeights::CorrelatedNormal { .. } = self.weights {
            self.weights = StratumWeights::Table(self.strata().map(|(share, _)| share).collect());
        }
        self
    }

    /// Share of a value for On with one for Off.
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

    /// How many values a pixel may be given for either polarity.
    pub(crate) fn n(&self) -> usize {
        self.values[0].len()
    }

    /// Those of a number, for On and for Off.
    pub(crate) fn at(&self, i: usize) -> PixelStratum {
        self.values.each_ref().map(|values| values[i])
    }

    /// Whether the values are even steps of a continuous one.
    pub(crate) fn is_continuous(&self) -> bool {
        self.every > 1
    }

    /// The course of a coarse score.
    pub(crate) const fn coarse_profile(&self) -> &LikelihoodProfile {
        &self.profile
    }

    /// The kind of all pixels, where they are alike.
    pub(crate) fn single(&self) -> Option<PixelStratum> {
        (self.n() == 1).then(|| self.at(0))
    }

    /// Kinds with their shares.
    pub fn strata(&self) -> impl Iterator<Item = (f64, PixelStratum)> + '_ {
        let n = self.n();
        let stratum = move |i: usize| [self.values[0][i / n], self.values[1][i % n]];
        (0..n * n).map(move |i| (self.weight(i / n, i % n), stratum(i)))
    }

    /// The kind that a number of 0 to 1 draws.
    #[must_use]
    pub fn draw(&self, mut uniform: f64) -> PixelStratum {
        let is_last = |(share, _): &(f64, PixelStratum)| {
            uniform -= share;
            uniform <= 0.0
        };
        self.strata().find(is_last).map_or(self.at(0), |(_, stratum)| stratum)
    }

    /// About how many times a pixel is scored.
    pub(crate) fn n_scored(&self) -> usize {
        if self.is_continuous() { TYPICAL_N_SCORED } else { self.n() }
    }

    /// Logarithm of a pixel's likelihood, given those of its On and its Off events for each value.
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

    /// The kind that those speak for most.
    pub(crate) fn most_likely(&self, [on, off]: &[Vec<f64>; 2]) -> PixelStratum {
        let (mut best, mut most) = ([0, 0], f64::NEG_INFINITY);
        let greatest = off.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (row, on) in on.iter().enumerate() {
            // A share is less than one: its logarithm makes none greater, and most rows need no look.
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

/// What a value of `n` counts in a sum by the trapezoidal rule.
const fn end(i: usize, n: usize) -> f64 {
    if i == 0 || i == n - 1 { 0.5 } else { 1.0 }
}

/// What the events of one polarity say of a pixel's value.
struct PolarityLikelihood {
    /// Logarithm of the greatest likelihood.
    most: f64,
    /// Values that an integral over all of them needs.
    at: StepBy<Range<usize>>,
    /// Likelihood of each over the greatest, times the values that it stands for.
    weights: Vec<f64>,
}

impl PolarityLikelihood {
    /// Likelihoods that bend smoothly are bells, of which the trapezoidal rule needs but a value a
    /// standard deviation. Values that are scored one by one are needed each: what On events rule out may
    /// be all that Off events leave.
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
        // Steps count from the first value, so that both ends are among them.
        let at = (first.next_multiple_of(step)..end).step_by(step);
        let weights = at.clone().map(|i| (logs[i] - most).exp() * step as f64).collect();
        Self { most, at, weights }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_passed_over_change_nothing() {
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
        /// Kinds of three values, a quarter, a half and a quarter, alike or apart for both polarities.
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
    fn the_best_kind_is_the_one_that_both_polarities_speak_for() {
        let logs = [vec![0.0, 2.0, 8.0], vec![8.0, 2.0, 0.0]];
        assert_eq!(PixelMixture::of_three(false).most_likely(&logs), [1.0, -1.0]);
        let [low, high] = [0.1, 0.9].map(|uniform| PixelMixture::of_three(true).draw(uniform));
        assert_eq!((low, high), ([-1.0; 2], [1.0; 2]));
    }

    #[test]
    fn kinds_of_which_each_polarity_rules_out_another_are_weighed_all_the_same() {
        let sums = [vec![-60.0, -100.0, 0.0], vec![0.0, -100.0, -50.0]];
        let got = PixelMixture::of_three(true).ln_likelihood(&sums);
        assert!((got - (-50.0 + 0.25_f64.ln())).abs() < 1e-3, "{got}");
    }
}
