//! Cluster bootstrap.
//!
//! A replicate draws as many clusters as there are, with replacement. The statistic is computed
//! from the clusters' sums, each weighted by the number of its draws (Davison and Hinkley,
//! Bootstrap Methods and their Application, 1997, section 3.8). Replicates are scaled by sqrt(G /
//! (G - 1)) about the value to correct the bias of the variance for G clusters. Each replicate has
//! its own random sequence from seed and number: results do not depend on the number of threads.

use evrig_core::stats::{Estimate, SplitMix, dot};
use rayon::prelude::*;

/// Resampling with a seed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bootstrap {
    seed: u64,
    n_replicates: usize,
}

impl Bootstrap {
    pub(super) fn new(seed: u64, n_replicates: usize) -> Self {
        Self { seed, n_replicates }
    }

    /// The estimate of `statistic`, a function of the clusters' weights (all 1 for the value). `n`
    /// is the sample size.
    pub(super) fn estimate(
        &self,
        n_clusters: usize,
        n: u64,
        statistic: impl Fn(&[f64]) -> f64 + Sync,
    ) -> Estimate {
        let value = statistic(&vec![1.0; n_clusters]);
        let mut replicates: Vec<f64> = (0..self.n_replicates as u64)
            .into_par_iter()
            .map(|number| statistic(&self.weights(n_clusters, number)))
            .filter(|replicate| replicate.is_finite())
            .collect();
        if n_clusters < 2 || replicates.len() * 2 < self.n_replicates || replicates.len() < 2 {
            return Estimate::with_interval(value, f64::NAN, [f64::NAN; 2], n);
        }
        let spread = (n_clusters as f64 / (n_clusters - 1) as f64).sqrt();
        for replicate in &mut replicates {
            *replicate = value + spread * (*replicate - value);
        }
        Estimate::from_replicates(value, &mut replicates, n)
    }

    /// The estimate of `above(w) / below(w)`, both sums over clusters.
    pub(super) fn ratio(&self, above: &[f64], below: &[f64], n: u64) -> Estimate {
        self.estimate(above.len(), n, |weights| dot(weights, above) / dot(weights, below))
    }

    fn weights(&self, n_clusters: usize, number: u64) -> Vec<f64> {
        let mut random = SplitMix::new(self.seed, number);
        let mut weights = vec![0.0; n_clusters];
        for _ in 0..n_clusters {
            weights[random.below(n_clusters)] += 1.0;
        }
        weights
    }

    /// Random flips of `n` clusters for a permutation test, independent of the replicates.
    pub(super) fn flips(&self, n: usize, number: u64) -> Vec<bool> {
        let mut random = SplitMix::new(self.seed ^ 0x666c_6970, number);
        (0..n).map(|_| random.bits() >> 63 == 1).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_gives_one_result_and_another_seed_another() {
        let samples: Vec<f64> = (0..50).map(|i| f64::from(i % 7)).collect();
        let mean = |seed| {
            Bootstrap::new(seed, 200).estimate(50, 50, |w| dot(w, &samples) / w.iter().sum::<f64>())
        };
        assert_eq!(mean(1), mean(1));
        assert_ne!(mean(1).standard_error, mean(2).standard_error);
    }

    #[test]
    fn the_error_of_a_mean_is_the_textbook_one() {
        let samples: Vec<f64> = (0..40).map(|i| f64::from((i * 17) % 40)).collect();
        let moments: evrig_core::stats::Moments = samples.iter().copied().collect();
        let estimate = Bootstrap::new(3, 20_000)
            .estimate(40, 40, |w| dot(w, &samples) / w.iter().sum::<f64>());
        let relative = estimate.standard_error / moments.standard_error();
        assert!((relative - 1.0).abs() < 0.02, "{relative}");
    }

    #[test]
    fn one_cluster_gives_a_value_without_error() {
        let estimate = Bootstrap::new(3, 100).estimate(1, 9, |w| w[0] * 2.0);
        assert_eq!(estimate.value, 2.0);
        assert!(estimate.standard_error.is_nan());
    }
}
