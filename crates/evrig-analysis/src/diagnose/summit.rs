//! The likelihood about a fit: its slopes and its curvature, taken as far away as matters.
//!
//! What one value may be changed by is orders of magnitude more than what another may, and some are told
//! only together. So a first star of evaluations along the values themselves finds about how the
//! log-likelihood falls, and a second one, along the directions that the first has found, how it falls where
//! it has fallen by a few nats: nearer it is rough, farther it is no parabola.

use super::fit::{Fitted, as_it_is};
use super::polish::pixels_for;
use super::score::Part;
use super::star::{About, Four, curvatures, moved};
use super::{Evidence, Hypothesis};
use nalgebra::{DMatrix, DVector};

/// Least curvature in any direction, where that of each value alone is one, and where that of each of the
/// directions that this leads to is one: below it small steps speak, not the data.
const LEAST_CURVATURE: f64 = 3e-3;
const LEAST_OF_MIXED: f64 = 0.2;

/// Rounds of going to a parabola's top, and the gain in nats that ends them.
const ROUNDS: usize = 6;
const ENOUGH: f64 = 0.05;

/// What a top may lie below the fit, as a share of what the log-likelihood falls by along the roughest direction: a
/// search stays on the highest of many small steps.
const BELOW: f64 = 0.5;

/// Curvature in units of what the fall along a direction stands for, below which that direction is taken to have this.
const LEAST_OF_FALL: f64 = 0.02;

/// Shares of the way to a top that are tried, until one leads up.
const SHARES: [f64; 2] = [1.0, 0.3];

/// Pixels on which the curvature is taken, and work of an evaluation, in instants of light, with which it is taken
/// on fewer, but on so many.
const PIXELS: usize = 160;
const WORK: usize = 3_000_000;
const LEAST_PIXELS: usize = 40;

/// Lengths of the directions behind which they are looked for anew.
const FAR_OFF: f64 = 1.0;

/// Slopes and curvature.
#[derive(Debug, Clone, Default)]
pub(super) struct Summit {
    /// Which values the events tell.
    free: Vec<usize>,
    /// Those that lie nearer to an end of their range than they are told, with their standard errors.
    untold: Vec<(usize, f64)>,
    /// Directions, column by column, in units of the values.
    directions: DMatrix<f64>,
    /// Slope of each training cell along each.
    slopes: DMatrix<f64>,
    /// Minus the second derivative along them.
    minus: DMatrix<f64>,
    /// Its inverse.
    inverse: DMatrix<f64>,
    /// Variance of each slope for the likelihood's small steps.
    rough: Vec<f64>,
    /// What the log-likelihood falls by along each, about.
    falls: Vec<f64>,
}

/// A fit gone to the top of the parabola about it, and what is there; `None` where nothing may move.
pub(super) fn climbed(evidence: &Evidence, fitted: Fitted) -> (Fitted, Option<Summit>) {
    let Some(mut summit) = Summit::of(evidence, &fitted) else { return (fitted, None) };
    let (top, way) = summit.climb(evidence, fitted);
    if way > FAR_OFF {
        let there = Summit::of(evidence, &top);
        return (top, there);
    }
    (top, Some(summit))
}

impl Summit {
    fn of(evidence: &Evidence, fitted: &Fitted) -> Option<Self> {
        let all = inside(&fitted.hypothesis);
        let held = fitted.held(evidence);
        let wanted = pixels_for(evidence, &held.hypothesis, WORK, [LEAST_PIXELS, PIXELS]);
        let few = evidence.thinned((evidence.pixels.len() + wanted / 2) / wanted);
        let mut about = About::of(&few, &held, &all);
        let star = about.own_directions();
        let (told, untold) = about.told(&star);
        let free: Vec<usize> = told.iter().map(|&i| all[i]).collect();
        if free.is_empty() {
            return None;
        }
        let spreads = about.spreads(&untold);
        let untold = untold.iter().map(|&i| all[i]).zip(spreads).collect();
        let star = star.select_columns(&told).select_rows(&told);
        let about = about.of_some(&told, &free);
        let directions = about.long_enough(unmixed(&about, &star)?);
        let minus = about.told_mixed(&directions)?;
        let four = Four::of(evidence, &held.hypothesis, &free, &directions);
        let falls = about.falls;
        Self { free, untold, directions, minus, falls, ..Self::default() }.with(&four)
    }

    /// The same directions as they are seen by a part of the evidence, from a fit to it.
    pub(super) fn of_part(&self, part: &Evidence, fitted: &Fitted) -> Option<Self> {
        self.clone().with(&self.four(part, fitted))
    }

    fn four(&self, evidence: &Evidence, fitted: &Fitted) -> Four {
        Four::of(evidence, &fitted.held(evidence).hypothesis, &self.free, &self.directions)
    }

    /// The same directions with what is seen along each; `None` where that is nothing to go by.
    fn with(mut self, four: &Four) -> Option<Self> {
        self.minus.set_diagonal(&DVector::from_vec(curvatures(&four.even)));
        self.inverse = inverse(&self.minus, &self.falls)?;
        (self.slopes, self.rough) = (four.slopes(), four.rough());
        Some(self)
    }

    /// A fit gone to the top, along the same directions all the way, and how many of their lengths it was.
    pub(super) fn climb(&mut self, evidence: &Evidence, mut fitted: Fitted) -> (Fitted, f64) {
        let mut way = 0.0;
        for _ in 0..ROUNDS {
            let (change, gain) = self.top();
            if gain < ENOUGH {
                break;
            }
            let at = |share| {
                let change = &self.directions * &change * share;
                as_it_is(evidence, moved(&fitted.hypothesis, &self.free, &change))
            };
            let below = BELOW * self.falls.iter().copied().fold(0.0, f64::max);
            let is_up = |(_, top): &(f64, Fitted)| nats(top) > nats(&fitted) - below;
            let mut tops = SHARES.into_iter().map(|share| (share, at(share)));
            let Some((share, top)) = tops.find(is_up) else { break };
            let Some(there) = self.clone().with(&self.four(evidence, &top)) else { break };
            way += share * change.norm();
            (*self, fitted) = (there, top);
        }
        (fitted, way)
    }

    /// How far the parabola's top is away along the directions, no farther than these go, and how much
    /// higher it is.
    fn top(&self) -> (DVector<f64>, f64) {
        let slope: DVector<f64> = self.slopes.row_sum().transpose();
        let change = &self.inverse * &slope;
        let gain = 0.5 * slope.dot(&change);
        let longest = change.amax().max(1.0);
        (change / longest, gain)
    }

    /// Standard errors of the values that may move, by their numbers, when slopes are alike within tiles and
    /// within blocks.
    pub(super) fn errors(&self, fitted: &Fitted, n_blocks: usize) -> Vec<(usize, f64)> {
        let training: Vec<usize> = fitted.cells.of(Part::Training).collect();
        let by = |cluster: &dyn Fn(usize) -> usize| {
            self.variances(training.iter().map(|&cell| cluster(cell)))
        };
        let tiles = by(&|cell| cell / n_blocks);
        let blocks = by(&|cell| cell % n_blocks);
        let cells = by(&|cell| cell);
        let told = (0..self.free.len())
            .map(|i| (tiles[i] + blocks[i] - cells[i]).max(tiles[i]).max(cells[i]).sqrt());
        self.free.iter().copied().zip(told).chain(self.untold.iter().copied()).collect()
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
        (0..p).for_each(|i| product[(i, i)] = product[(i, i)].max(self.rough[i]));
        let root = &self.directions * &self.inverse;
        let sandwich = &root * product * root.transpose();
        (0..p).map(|i| sandwich[(i, i)].max(0.0)).collect()
    }
}

/// Log-likelihood of the training cells.
fn nats(fitted: &Fitted) -> f64 {
    fitted.cells.total(Part::Training)
}

/// The values that may move: one at an end of its range is held there by it.
fn inside(hypothesis: &Hypothesis) -> Vec<usize> {
    let is_inside = |&i: &usize| {
        let ([low, high], value) = (hypothesis.ranges[i], hypothesis.values[i]);
        let margin = 1e-9 * (high - low);
        hypothesis.steps[i] > 0.0 && value > low + margin && value < high - margin
    };
    (0..hypothesis.values.len()).filter(is_inside).collect()
}

/// Square roots of the curvatures along the directions themselves, of which none is next to nothing.
fn scales(minus: &DMatrix<f64>, falls: &[f64]) -> Vec<f64> {
    let own = |(i, fall): (usize, &f64)| minus[(i, i)].max(LEAST_OF_FALL * fall).sqrt();
    falls.iter().enumerate().map(own).collect()
}

fn scaled(
    minus: &DMatrix<f64>,
    scales: &[f64],
) -> Option<nalgebra::SymmetricEigen<f64, nalgebra::Dyn>> {
    let p = scales.len();
    let scaled = DMatrix::from_fn(p, p, |i, j| minus[(i, j)] / (scales[i] * scales[j]));
    scaled.iter().all(|v| v.is_finite()).then(|| scaled.symmetric_eigen())
}

/// Inverse of a curvature, brought to the same scale in all directions so that they compare.
fn inverse(minus: &DMatrix<f64>, falls: &[f64]) -> Option<DMatrix<f64>> {
    let (p, scales) = (minus.nrows(), scales(minus, falls));
    let mut eigen = scaled(minus, &scales)?;
    eigen.eigenvalues.iter_mut().for_each(|v| *v = v.max(LEAST_OF_MIXED).recip());
    let inverse = eigen.recompose();
    Some(DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] / (scales[i] * scales[j])))
}

/// Columns that do not mix, each as long as makes the log-likelihood fall as its own place in `falls` says.
fn apart(minus: &DMatrix<f64>, falls: &[f64]) -> Option<DMatrix<f64>> {
    let (p, scales) = (falls.len(), scales(minus, falls));
    let eigen = scaled(minus, &scales)?;
    let far = |k: usize| (2.0 * falls[k] / eigen.eigenvalues[k].max(LEAST_CURVATURE)).sqrt();
    Some(DMatrix::from_fn(p, p, |l, k| eigen.eigenvectors[(l, k)] * far(k) / scales[l]))
}

/// Directions along which the curvature is the same and which do not mix where `star`, each value by itself,
/// has been. A value with little room stays a direction of its own, or it would leave the others none either. Values
/// along which the log-likelihood is rough mix among themselves: a little of them in every direction would make all
/// of these as rough.
fn unmixed(about: &About<'_>, star: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let minus = about.curvature(star)?;
    let roomy = (0..star.ncols()).filter(|&i| !about.is_cramped(star, i));
    let (rough, smooth): (Vec<usize>, Vec<usize>) = roomy.partition(|&i| about.is_rough(i));
    let mut directions = star.clone();
    for group in [rough, smooth].into_iter().filter(|group| !group.is_empty()) {
        let minus = minus.select_columns(&group).select_rows(&group);
        let falls: Vec<f64> = group.iter().map(|&i| about.falls[i]).collect();
        let shares = apart(&minus, &falls)?;
        for (&column, shares) in group.iter().zip(shares.column_iter()) {
            directions.column_mut(column).fill(0.0);
            let own = group.iter().zip(shares.iter());
            own.for_each(|(&row, share)| directions[(row, column)] = star[(row, row)] * share);
        }
    }
    Some(directions)
}
