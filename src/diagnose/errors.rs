//! Errors of a fitted hypothesis that hold although the model is not the truth.
//!
//! The curvature of the log-likelihood says how far a value moves when the gradient does; how much
//! the gradient scatters is seen from the data, between tiles of pixels and between blocks of time
//! (Huber, 1967; White, Econometrica 50, 1982; two ways of clustering after Cameron, Gelbach and
//! Miller, J. Bus. Econ. Stat. 29, 2011). The gradients' own product in place of the curvature
//! would claim to know the more, the less the model fits.

use super::fit::{Fitted, gradients};
use super::score::{Part, cells_of_each};
use super::{Evidence, Hypothesis};
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Pixels on which the curvature is taken.
const PIXELS_FOR_CURVATURE: usize = 160;

/// The same fit with the standard errors of all values inside their ranges.
pub(super) fn with_errors(evidence: &Evidence, fitted: Fitted) -> Fitted {
    let here = fitted.held(evidence);
    let (all_free, all_gradients) = gradients(evidence, &here);
    // A value at the end of its range is held there by it and has no error of its own.
    let is_inside = |i: usize| {
        let [low, high] = fitted.hypothesis.ranges[i];
        let margin = 1e-9 * (high - low);
        fitted.hypothesis.values[i] > low + margin && fitted.hypothesis.values[i] < high - margin
    };
    let columns: Vec<usize> = (0..all_free.len()).filter(|&c| is_inside(all_free[c])).collect();
    let free: Vec<usize> = columns.iter().map(|&c| all_free[c]).collect();
    if free.is_empty() {
        return fitted;
    }
    let gradients = all_gradients.select_columns(&columns);
    let Some(inverse) = curvature(evidence, &here, &free, &gradients) else { return fitted };
    let training: Vec<usize> = fitted.cells.of(Part::Training).collect();
    let n_blocks = evidence.blocks.n();
    let by = |cluster: &dyn Fn(usize) -> usize| {
        variances(&inverse, &gradients, training.iter().map(|&cell| cluster(cell)))
    };
    let tiles = by(&|cell| cell / n_blocks);
    let blocks = by(&|cell| cell % n_blocks);
    let cells = by(&|cell| cell);
    let errors = (0..free.len())
        .map(|i| (tiles[i] + blocks[i] - cells[i]).max(tiles[i]).max(cells[i]).sqrt())
        .collect();
    Fitted { errors: Some((free, errors)), ..fitted }
}

/// Variance of each value when gradients are alike within a cluster.
fn variances(
    inverse: &DMatrix<f64>,
    gradients: &DMatrix<f64>,
    clusters: impl Iterator<Item = usize>,
) -> Vec<f64> {
    let p = gradients.ncols();
    let mut sums: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for (row, cluster) in clusters.enumerate() {
        let sum = sums.entry(cluster).or_insert_with(|| vec![0.0; p]);
        sum.iter_mut().zip(gradients.row(row).iter()).for_each(|(s, g)| *s += g);
    }
    sums.retain(|_, sum| sum.iter().any(|s| *s != 0.0));
    let n = sums.len().max(2) as f64;
    let mut product = DMatrix::zeros(p, p);
    for sum in sums.values() {
        for i in 0..p {
            for j in 0..p {
                product[(i, j)] += sum[i] * sum[j];
            }
        }
    }
    // Few clusters seem to scatter less than they do.
    let sandwich = inverse * product * inverse * (n / (n - 1.0));
    (0..p).map(|i| sandwich[(i, i)].max(0.0)).collect()
}

/// Steps of about an error: there a log-likelihood with kinks looks as smooth as it matters.
fn steps(hypothesis: &Hypothesis, free: &[usize], rough: &DMatrix<f64>) -> Vec<f64> {
    let of = |(i, &f): (usize, &usize)| {
        let step = hypothesis.steps[f];
        let [low, high] = hypothesis.ranges[f];
        let room = 0.5 * (hypothesis.values[f] - low).min(high - hypothesis.values[f]);
        let error = rough[(i, i)].max(1e-300).sqrt().recip();
        error.clamp(0.5 * step, 4.0 * step).min(room)
    };
    free.iter().enumerate().map(of).collect()
}

/// Inverse of minus the log-likelihood's second derivative over the training cells.
fn curvature(
    evidence: &Evidence,
    fitted: &Fitted,
    free: &[usize],
    gradients: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let few = evidence.thinned(evidence.pixels.len().div_ceil(PIXELS_FOR_CURVATURE));
    let hypothesis = &fitted.hypothesis;
    let p = free.len();
    let rough = gradients.transpose() * gradients;
    let steps = steps(hypothesis, free, &rough);
    let moved = |by: &[(usize, f64)]| {
        let mut other = hypothesis.clone();
        by.iter().for_each(|(i, sign)| other.values[free[*i]] += sign * steps[*i]);
        other
    };
    let mut asked = vec![moved(&[])];
    for i in 0..p {
        asked.push(moved(&[(i, 1.0)]));
        asked.push(moved(&[(i, -1.0)]));
    }
    for i in 0..p {
        for j in 0..i {
            asked.push(moved(&[(i, 1.0), (j, 1.0)]));
            asked.push(moved(&[(i, -1.0), (j, -1.0)]));
        }
    }
    let asked: Vec<&Hypothesis> = asked.iter().collect();
    let mut n_events = 0.0;
    let answers: Vec<f64> = cells_of_each(&few, &asked)
        .iter()
        .map(|cells| {
            n_events = cells.of(Part::Training).map(|cell| cells.n_events[cell]).sum();
            cells.of(Part::Training).map(|cell| cells.log_likelihood[cell]).sum()
        })
        .collect();
    let of_all: f64 = fitted.cells.of(Part::Training).map(|c| fitted.cells.n_events[c]).sum();
    let scale = of_all / f64::max(n_events, 1.0);
    let here = answers[0];
    let one = |i: usize| answers[1 + 2 * i] + answers[2 + 2 * i];
    // In units of the steps.
    let mut minus = DMatrix::zeros(p, p);
    let mut next = 1 + 2 * p;
    for i in 0..p {
        minus[(i, i)] = -(one(i) - 2.0 * here);
        for j in 0..i {
            let both = answers[next] + answers[next + 1];
            next += 2;
            let mixed = -0.5 * (both - one(i) - one(j) + 2.0 * here);
            minus[(i, j)] = mixed;
            minus[(j, i)] = mixed;
        }
    }
    for i in 0..p {
        for j in 0..p {
            minus[(i, j)] *= scale / (steps[i] * steps[j]);
        }
    }
    let scales: Vec<f64> = (0..p).map(|i| rough[(i, i)].max(1e-300).sqrt()).collect();
    inverse(minus, &scales)
}

/// Least curvature in any direction, where that of the gradients' own product is one: below it a
/// kink or a fit that stopped early speaks, not the data.
const LEAST_CURVATURE: f64 = 0.03;

/// Inverse of the curvature. It is brought to the scale of the gradients first, so that directions
/// compare.
fn inverse(minus: DMatrix<f64>, scales: &[f64]) -> Option<DMatrix<f64>> {
    let p = scales.len();
    let scaled = DMatrix::from_fn(p, p, |i, j| minus[(i, j)] / (scales[i] * scales[j]));
    if scaled.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let mut eigen = scaled.symmetric_eigen();
    eigen.eigenvalues.iter_mut().for_each(|v| *v = v.max(LEAST_CURVATURE).recip());
    let inverse = eigen.recompose();
    Some(DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] / (scales[i] * scales[j])))
}
