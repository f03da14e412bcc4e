//! The likelihood about a fit: its slopes and its curvature, taken as far away as matters.
//!
//! What one value may be changed by is orders of magnitude more than what another may, and some are told
//! only together. So a first star of evaluations along the values themselves finds about how the
//! log-likelihood falls, and a second one, along the directions that the first has found, how it falls where
//! it has fallen by a few nats: nearer it is rough, farther it is no parabola.

use super::cell_scores::{CellScores, CellSet};
use super::curvature_probes::{CellProbes, curvatures};
use nalgebra::{DMatrix, DVector};

/// Least eigenvalue of a scaled curvature, along coordinates and along conjugate directions:
/// numerical noise dominates below.
const MIN_SCALED_EIGENVALUE: f64 = 3e-3;
const MIN_CONJUGATE_EIGENVALUE: f64 = 0.2;

/// Least curvature of a direction, as a share of its drop target.
const MIN_CURVATURE_SHARE: f64 = 0.02;

/// Slopes and curvature.
#[derive(Debug, Clone, Default)]
pub(crate) struct LaplaceApproximation {
    /// Which values the events tell.
    pub(crate) free: Vec<usize>,
    /// Those that lie nearer to an end of their range than they are told, with their standard errors.
    pub(crate) bound_limited: Vec<(usize, f64)>,
    /// Directions, column by column, in units of the values.
    pub(crate) directions: DMatrix<f64>,
    /// Slope of each training cell along each.
    pub(crate) slopes: DMatrix<f64>,
    /// Minus the second derivative along them.
    pub(crate) minus: DMatrix<f64>,
    /// Its inverse.
    pub(crate) inverse: DMatrix<f64>,
    /// Variance of each slope for the likelihood's small steps.
    pub(crate) roughness: Vec<f64>,
    /// What the log-likelihood falls by along each, about.
    pub(crate) drop_targets: Vec<f64>,
}

impl LaplaceApproximation {
    /// The same directions with what is seen along each; `None` where that is nothing to go by.
    pub(crate) fn with_probes(mut self, probes: &CellProbes) -> Option<Self> {
        self.minus.set_diagonal(&DVector::from_vec(curvatures(&probes.even)));
        self.inverse = inverse(&self.minus, &self.drop_targets)?;
        (self.slopes, self.roughness) = (probes.slopes(), probes.rough());
        Some(self)
    }

    /// How far the parabola's top is away along the directions, no farther than these go, and how much
    /// higher it is.
    pub(crate) fn newton_step(&self) -> (DVector<f64>, f64) {
        let slope: DVector<f64> = self.slopes.row_sum().transpose();
        let change = &self.inverse * &slope;
        let gain = 0.5 * slope.dot(&change);
        let longest = change.amax().max(1.0);
        (change / longest, gain)
    }

    /// Standard errors of the values that may move, by their numbers, when slopes are alike within tiles and
    /// within blocks.
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

    /// Variance of each value when slopes are alike within a cluster of cells.
    fn variances(&self, clusters: impl Iterator<Item = usize>) -> Vec<f64> {
        let p = self.free.len();
        let mut sums = std::collections::BTreeMap::new();
        for (row, cluster) in clusters.enumerate() {
            let sum = sums.entry(cluster).or_insert_with(|| DVector::zeros(p));
            *sum += self.slopes.row(row).transpose();
        }
        sums.retain(|_, sum: &mut DVector<f64>| sum.iter().any(|s| *s != 0.0));
        // Few clusters seem to scatter less than they do.
        let n = sums.len().max(2) as f64;
        let mut product = DMatrix::zeros(p, p);
        sums.values().for_each(|sum| product += sum * sum.transpose() * (n / (n - 1.0)));
        // The small steps are in the scatter already, as far as clusters are enough to show it.
        (0..p).for_each(|i| product[(i, i)] = product[(i, i)].max(self.roughness[i]));
        let root = &self.directions * &self.inverse;
        let sandwich = &root * product * root.transpose();
        (0..p).map(|i| sandwich[(i, i)].max(0.0)).collect()
    }
}

/// Square roots of the curvatures along the directions themselves, of which none is next to nothing.
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

/// Inverse of a curvature, brought to the same scale in all directions so that they compare.
fn inverse(minus: &DMatrix<f64>, drop_targets: &[f64]) -> Option<DMatrix<f64>> {
    let (p, scales) = (minus.nrows(), scales(minus, drop_targets));
    let mut eigen = scaled_eigen(minus, &scales)?;
    eigen.eigenvalues.iter_mut().for_each(|v| *v = v.max(MIN_CONJUGATE_EIGENVALUE).recip());
    let inverse = eigen.recompose();
    Some(DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] / (scales[i] * scales[j])))
}

/// Columns that do not mix, each as long as makes the log-likelihood fall as its own place in `falls` says.
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
