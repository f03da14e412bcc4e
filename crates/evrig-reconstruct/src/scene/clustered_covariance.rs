//! Cluster-robust covariance.

use nalgebra::{SMatrix, SVector};

/// Number of clusters of neighbouring frames or features.
const CLUSTERS: usize = 24;

/// Cluster-robust covariance of a fit from the inverse of its normal equations and the scores at
/// the solution, ordered in time or over the map (Liang and Zeger, 1986, with a correction for the
/// degrees of freedom).
pub(super) fn clustered_covariance<const N: usize>(
    inverse: &SMatrix<f64, N, N>,
    scores: &[SVector<f64, N>],
) -> SMatrix<f64, N, N> {
    let share = scores.len().div_ceil(CLUSTERS).max(1);
    let mut sum = SMatrix::<f64, N, N>::zeros();
    let mut n_groups = 0;
    for group in scores.chunks(share) {
        let score: SVector<f64, N> = group.iter().sum();
        sum += score * score.transpose();
        n_groups += 1;
    }
    let n = n_groups as f64;
    // With as many clusters as unknowns the scores carry no information.
    let freedom = (n - N as f64).max(1.0);
    inverse * sum * inverse * (n / freedom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_that_go_together_make_the_error_of_a_mean_larger_by_as_much() {
        // 240 values in groups of ten equal ones: the mean's error is that of 24 values.
        let value =
            |i: usize| f64::from(((i / 10) as u32).wrapping_mul(2_654_435_761) >> 16) / 65_536.0;
        let values: Vec<f64> = (0..240).map(value).collect();
        let mean = values.iter().sum::<f64>() / 240.0;
        let scores: Vec<_> = values.iter().map(|v| SVector::<f64, 1>::new(v - mean)).collect();
        let inverse = SMatrix::<f64, 1, 1>::new(1.0 / 240.0);
        let found = clustered_covariance(&inverse, &scores)[(0, 0)];
        let spread = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 240.0;
        assert!((found / (spread / 23.0) - 1.0).abs() < 1e-9, "{found} {spread}");
    }
}
