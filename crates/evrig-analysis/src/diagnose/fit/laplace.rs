//! Laplace approximation of the likelihood around a fit.
//!
//! Parameters differ by orders of magnitude in scale, and some are identified only jointly. A
//! first set of probes along single parameters finds the scales; a second set, along decorrelated
//! directions, measures the curvature where the log-likelihood has dropped by a few nats. Nearer,
//! numerical noise dominates; farther, it is not quadratic.

use super::cell_scores::{CellScores, CellSet};
use super::curvature_probes::{CellProbes, curvatures};
use nalgebra::{DMatrix, DVector};

/// Least eigenvalue of a scaled curvature, along coordinates and along conjugate directions:
/// numerical noise dominates below.
const MIN_SCALED_EIGENVALUE: f64 = 3e-3;
const MIN_CONJUGATE_EIGENVALUE: f64 = 0.2;

/// Least curvature of a direction, as a share of its drop target.
const MIN_CURVATURE_SHARE: f64 = 0.02;

/// Gradients and curvature along a set of directions.
#[derive(Debug, Clone, Default)]
pub(crate) struct LaplaceApproximation {
    /// Indices of the identified values.
    pub(crate) free: Vec<usize>,
    /// Values that their range limits, with standard errors.
    pub(crate) bound_limited: Vec<(usize, f64)>,
    /// Directions, one per column.
    pub(crate) directions: DMatrix<f64>,
    /// Slopes, one row per training cell.
    pub(crate) slopes: DMatrix<f64>,
    /// Negative Hessian.
    pub(crate) minus: DMatrix<f64>,
    /// Its inverse.
    pub(crate) inverse: DMatrix<f64>,
    /// Numerical noise variance of each slope.
    pub(crate) roughness: Vec<f64>,
    /// Target drop along each direction.
    pub(crate) drop_targets: Vec<f64>,
}

impl LaplaceApproximation {
    /// The same directions with new probes; `None` without a valid curvature.
    pub(crate) fn with_probes(mut self, probes: &CellProbes) -> Option<Self> {
        self.minus.set_diagonal(&DVector::from_vec(curvatures(&probes.even)));
        self.inverse = inverse(&self.minus, &self.drop_targets)?;
        (self.slopes, self.roughness) = (probes.slopes(), probes.rough());
        Some(self)
    }

    /// Newton step in units of the directions, clipped to their length, and its gain.
    pub(crate) fn newton_step(&self) -> (DVector<f64>, f64) {
        let slope: DVector<f64> = self.slopes.row_sum().transpose();
        let change = &self.inverse * &slope;
        let gain = 0.5 * slope.dot(&change);
        let longest = change.amax().max(1.0);
        (change / longest, gain)
    }

    /// Standard errors of the free values by index, clustered by tile and by block.
    pub(crate) fn errors(&self, cells: &CellScores, n_blocks: usize) -> Vec<(usize, f64)> {
        let training: Vec<usize> = cells.of(CellSet::Training).collect();
        let by = |cluster: &dyn Fn(usize) -> usize| {
            self.variances(training.iter().map(|&cell| cluster(cell)))
        };
        let tiles = by(&|cell| cell / n_blocks);
        let blocks = by(&|cell| cell % n_blocks);
        let cells = by(&|cell| cell);
        let identified = (0..self.free.len())
            .map(|i| (tiles[i] + blocks[i] - cells[i]).max(tiles[i]).max(cells[i]).sqrt());
        self.free
            .iter()
            .copied()
            .zip(identified)
            .chain(self.bound_limited.iter().copied())
            .collect()
    }

    /// Variances of the values with scores clustered by cell groups (sandwich estimator).
    fn variances(&self, clusters: impl Iterator<Item = usize>) -> Vec<f64> {
        let p = self.free.len();
        let mut sums = std::collections::BTreeMap::new();
        for (row, cluster) in clusters.enumerate() {
            let sum = sums.entry(cluster).or_insert_with(|| DVector::zeros(p));
            *sum += self.slopes.row(row).transpose();
        }
        sums.retain(|_, sum: &mut DVector<f64>| sum.iter().any(|s| *s != 0.0));
        // Small-sample correction for few clusters.
        let n = sums.len().max(2) as f64;
        let mut product = DMatrix::zeros(p, p);
        sums.values().for_each(|sum| product += sum * sum.transpose() * (n / (n - 1.0)));
        // The scatter includes numerical noise only if clusters are enough to show it.
        (0..p).for_each(|i| product[(i, i)] = product[(i, i)].max(self.roughness[i]));
        let root = &self.directions * &self.inverse;
        let sandwich = &root * product * root.transpose();
        (0..p).map(|i| sandwich[(i, i)].max(0.0)).collect()
    }
}

/// Square roots of the diagonal curvatures, bounded below.
fn scales(minus: &DMatrix<f64>, drop_targets: &[f64]) -> Vec<f64> {
    let own = |(i, fall): (usize, &f64)| minus[(i, i)].max(MIN_CURVATURE_SHARE * fall).sqrt();
    drop_targets.iter().enumerate().map(own).collect()
}

fn scaled_eigen(
    minus: &DMatrix<f64>,
    scales: &[f64],
) -> Option<nalgebra::SymmetricEigen<f64, nalgebra::Dyn>> {
    let p = scales.len();
    let scaled = DMatrix::from_fn(p, p, |i, j| minus[(i, j)] / (scales[i] * scales[j]));
    scaled.iter().all(|v| v.is_finite()).then(|| scaled.symmetric_eigen())
}

/// Inverse of a curvature, scaled to a unit diagonal.
fn inverse(minus: &DMatrix<f64>, drop_targets: &[f64]) -> Option<DMatrix<f64>> {
    let (p, scales) = (minus.nrows(), scales(minus, drop_targets));
    let mut eigen = scaled_eigen(minus, &scales)?;
    eigen.eigenvalues.iter_mut().for_each(|v| *v = v.max(MIN_CONJUGATE_EIGENVALUE).recip());
    let inverse = eigen.recompose();
    Some(DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] / (scales[i] * scales[j])))
}

/// Conjugate directions with their target drops.
pub(crate) fn conjugate_directions(
    minus: &DMatrix<f64>,
    drop_targets: &[f64],
) -> Option<DMatrix<f64>> {
    let (p, scales) = (drop_targets.len(), scales(minus, drop_targets));
    let eigen = scaled_eigen(minus, &scales)?;
    let far =
        |k: usize| (2.0 * drop_targets[k] / eigen.eigenvalues[k].max(MIN_SCALED_EIGENVALUE)).sqrt();
    Some(DMatrix::from_fn(p, p, |l, k| eigen.eigenvectors[(l, k)] * far(k) / scales[l]))
}
