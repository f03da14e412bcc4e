//! Log-likelihood probes around a fit, along directions of suitable length.

use super::cell_scores::{CellScores, CellSet, score_cells_of_each};
use crate::diagnose::{Evidence, Hypothesis};
use evrig_core::stats::upper_median;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Log-likelihood drop at which curvature is measured: at least, in units of the numerical noise,
/// and at most.
const MIN_DROP_NATS: f64 = 4.0;
const DROP_IN_NOISE_FLOORS: f64 = 6.0;
const MAX_DROP_NATS: f64 = 100.0;

/// Probes to either side for the noise floor: the residual of a polynomial with this many terms.
const N_NOISE_PROBES: usize = 6;
const N_NOISE_TERMS: usize = 5;

/// Probe distances along a direction, to either side.
const PROBE_DISTANCES: [f64; 2] = [1.0, 0.5];

/// A value is identified if the drop at its bound is above this share of the target and this many
/// noise floors.
const MIN_IDENTIFIED_DROP_SHARE: f64 = 0.05;
const MIN_IDENTIFIED_NOISE_FLOORS: f64 = 2.0;

/// Rescalings of a direction, and largest factor of each.
const MAX_RESCALINGS: usize = 4;
const MAX_RESCALING_FACTOR: f64 = 5.0;

/// A direction is done when its factor lies in this range, or its length changes by less than this
/// share.
const ACCEPTED_FACTORS: Range<f64> = 0.6..1.7;
const MIN_LENGTH_CHANGE: f64 = 0.01;

/// Halvings of the distance to a bound in the search for a one-sided error.
const N_HALVINGS: i32 = 14;

/// Outlier of a squared residual over the median: (3 sigma)^2 over the median of chi-squared,
/// 0.455.
const OUTLIER_RATIO: f64 = 9.0 / 0.455;

/// Share of the distance to the nearer bound that a direction may use.
const USED_MARGIN_SHARE: f64 = 0.9;

/// Probes around a fit, on a subset of the pixels.
pub(crate) struct CurvatureProbes<'a> {
    few: &'a Evidence,
    at: &'a Hypothesis,
    free: &'a [usize],
    /// Distance of each value to its nearer bound.
    margin: Vec<f64>,
    /// Events of all pixels over those of the subset.
    scale: f64,
    /// Log-likelihood at the fit.
    nats: f64,
    /// Numerical noise floor along each value, nats.
    noise_steps: Vec<f64>,
    /// Target drop of the log-likelihood along each direction.
    pub(crate) drop_targets: Vec<f64>,
}

impl<'a> CurvatureProbes<'a> {
    /// `cells` are the scores on all pixels.
    pub(crate) fn of(
        few: &'a Evidence,
        at: &'a Hypothesis,
        cells: &CellScores,
        free: &'a [usize],
    ) -> Self {
        let margin = |&i: &usize| {
            let [low, high] = at.ranges[i];
            USED_MARGIN_SHARE * (at.values[i] - low).min(high - at.values[i])
        };
        let here = score_cells_of_each(few, &[at]).remove(0);
        let scale = cells.events(CellSet::Training) / here.events(CellSet::Training).max(1.0);
        let nats = scale * here.total(CellSet::Training);
        let (noise_steps, drop_targets) = (vec![0.0; free.len()], vec![MIN_DROP_NATS; free.len()]);
        Self {
            few,
            at,
            free,
            margin: free.iter().map(margin).collect(),
            scale,
            nats,
            noise_steps,
            drop_targets,
        }
    }

    /// The probes of some values.
    pub(crate) fn of_some(&self, places: &[usize], free: &'a [usize]) -> Self {
        let some = |of: &[f64]| places.iter().map(|&i| of[i]).collect();
        let (margin, noise_steps, drop_targets) =
            (some(&self.margin), some(&self.noise_steps), some(&self.drop_targets));
        Self { free, margin, noise_steps, drop_targets, ..*self }
    }

    /// Log-likelihood at points in units of the directions.
    fn at(&self, directions: &DMatrix<f64>, points: &[DVector<f64>]) -> Vec<f64> {
        let there = |point: &DVector<f64>| moved(self.at, self.free, &(directions * point));
        let asked: Vec<Hypothesis> = points.iter().map(there).collect();
        let cells = score_cells_of_each(self.few, &asked.iter().collect::<Vec<_>>());
        cells.iter().map(|cells| self.scale * cells.total(CellSet::Training)).collect()
    }

    /// Log-likelihood at both distances, mean of the two sides.
    fn mean_sides(&self, directions: &DMatrix<f64>) -> [Vec<f64>; 2] {
        let p = directions.ncols();
        let ends = |far: f64| (0..p).flat_map(move |i| [far, -far].map(|by| point(p, &[(i, by)])));
        let points: Vec<DVector<f64>> = PROBE_DISTANCES.into_iter().flat_map(ends).collect();
        let means: Vec<f64> = means(&self.at(directions, &points));
        [means[..p].to_vec(), means[p..].to_vec()]
    }

    /// Drop of the log-likelihood along each direction, from the curvature.
    fn drops(&self, directions: &DMatrix<f64>) -> Vec<f64> {
        curvatures(&self.mean_sides(directions)).into_iter().map(|own| 0.5 * own).collect()
    }

    /// Root mean square residual of a polynomial along each direction.
    fn noise_floors(&self, directions: &DMatrix<f64>) -> Vec<f64> {
        let p = self.free.len();
        let ways: Vec<f64> = (1..=N_NOISE_PROBES)
            .flat_map(|k| [1.0, -1.0].map(|side| side * k as f64 / N_NOISE_PROBES as f64))
            .collect();
        let smooth =
            DMatrix::from_fn(ways.len(), N_NOISE_TERMS, |k, power| ways[k].powi(power as i32));
        let smooth = smooth.qr().q();
        let asked = (0..p).flat_map(|i| ways.iter().map(move |way| point(p, &[(i, *way)])));
        let nats = self.at(directions, &asked.collect::<Vec<_>>());
        let height = |nats: &[f64]| {
            let upper_tail_probability =
                DVector::from_iterator(nats.len(), nats.iter().map(|nats| nats - self.nats));
            let left = &upper_tail_probability - &smooth * smooth.tr_mul(&upper_tail_probability);
            (left.norm_squared() / (ways.len() - N_NOISE_TERMS) as f64).sqrt()
        };
        nats.chunks(ways.len()).map(height).collect()
    }

    /// Whether numerical noise dominates along a value.
    pub(crate) fn is_rough(&self, i: usize) -> bool {
        self.drop_targets[i] > MIN_DROP_NATS
    }

    /// Whether a value's direction is limited by its range.
    pub(crate) fn is_bound_limited(&self, star: &DMatrix<f64>, i: usize) -> bool {
        star[(i, i)] >= 0.99 * self.margin[i]
    }

    /// Indices of the identified values, and of those that their range limits.
    pub(crate) fn split_by_identifiability(&self, star: &DMatrix<f64>) -> (Vec<usize>, Vec<usize>) {
        let drops = self.drops(star);
        let least = |i: usize| {
            (MIN_IDENTIFIED_DROP_SHARE * self.drop_targets[i])
                .max(MIN_IDENTIFIED_NOISE_FLOORS * self.noise_steps[i])
        };
        let all = 0..self.free.len();
        all.partition(|&i| !self.is_bound_limited(star, i) || drops[i] > least(i))
    }

    /// Standard errors of range-limited values: from the drop in the wider direction, or the
    /// distance to the bound.
    pub(crate) fn bound_limited_errors(&self, untold: &[usize]) -> Vec<f64> {
        let p = self.free.len();
        let own = DMatrix::identity(p, p);
        let side = |i: usize, end: f64| {
            let to_the_end = end - self.at.values[self.free[i]];
            let ways: Vec<f64> =
                (0..N_HALVINGS).rev().map(|k| to_the_end * 0.5_f64.powi(k)).collect();
            let points: Vec<DVector<f64>> = ways.iter().map(|way| point(p, &[(i, *way)])).collect();
            let drop_targets = self.at(&own, &points).into_iter().map(|nats| self.nats - nats);
            let known =
                ways.iter().zip(drop_targets).find(|(_, fall)| *fall >= 0.5 * self.drop_targets[i]);
            known.map_or(to_the_end.abs(), |(way, fall)| way.abs() / (2.0 * fall).sqrt())
        };
        let wider = |&i: &usize| {
            let [low, high] = self.at.ranges[self.free[i]];
            side(i, low).max(side(i, high))
        };
        untold.iter().map(wider).collect()
    }

    /// One direction per value, longer where numerical noise dominates.
    pub(crate) fn coordinate_directions(&mut self) -> DMatrix<f64> {
        let step = |i: usize| self.at.steps[self.free[i]].min(self.margin[i]);
        let noise_steps = DVector::from_fn(self.free.len(), |i, _| step(i));
        let star = self.scaled_to_drop(DMatrix::from_diagonal(&noise_steps));
        self.noise_steps = self.noise_floors(&star);
        let drop_targets = self.noise_steps.iter().map(|height| DROP_IN_NOISE_FLOORS * height);
        let most = drop_targets.clone().fold(MIN_DROP_NATS, f64::max).min(MAX_DROP_NATS);
        // Noisy values will be mixed: all use the largest target.
        self.drop_targets = drop_targets
            .map(|fall| if fall > MIN_DROP_NATS { most } else { MIN_DROP_NATS })
            .collect();
        if most > MIN_DROP_NATS { self.scaled_to_drop(star) } else { star }
    }

    fn clipped_to_ranges(&self, mut directions: DMatrix<f64>) -> DMatrix<f64> {
        for mut direction in directions.column_iter_mut() {
            let shares =
                direction.iter().zip(&self.margin).map(|(d, margin)| margin / d.abs().max(1e-300));
            let share = shares.fold(1.0, f64::min);
            direction *= share;
        }
        directions
    }

    /// Directions scaled to their target drop, within the ranges.
    pub(crate) fn scaled_to_drop(&self, directions: DMatrix<f64>) -> DMatrix<f64> {
        let mut directions = self.clipped_to_ranges(directions);
        let mut open: Vec<usize> = (0..directions.ncols()).collect();
        for _ in 0..MAX_RESCALINGS {
            let before = directions.clone();
            let drops = self.drops(&before.select_columns(&open));
            let factor =
                |(&i, drops): (&usize, f64)| (i, length_factor(drops / self.drop_targets[i]));
            let factors: Vec<(usize, f64)> = open.iter().zip(drops).map(factor).collect();
            factors.iter().for_each(|&(i, factor)| directions.column_mut(i).scale_mut(factor));
            directions = self.clipped_to_ranges(directions);
            // Directions that were nearly right, or that fill their range, are done.
            let change = |i: usize| (directions.column(i) - before.column(i)).norm();
            let is_open = |&(i, factor): &(usize, f64)| {
                !ACCEPTED_FACTORS.contains(&factor)
                    && change(i) > MIN_LENGTH_CHANGE * before.column(i).norm()
            };
            open = factors.into_iter().filter(is_open).map(|(i, _)| i).collect();
            if open.is_empty() {
                break;
            }
        }
        directions
    }

    /// Negative Hessian along directions.
    pub(crate) fn curvature(&self, directions: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let mut minus = self.cross_terms(directions)?;
        minus.set_diagonal(&DVector::from_vec(curvatures(&self.mean_sides(directions))));
        minus.iter().all(|m| m.is_finite()).then_some(minus)
    }

    /// Off-diagonal terms of the negative Hessian. Terms below the numerical noise floor of both
    /// directions are dropped: they would spread the noise to all standard errors.
    pub(crate) fn significant_cross_terms(
        &self,
        directions: &DMatrix<f64>,
    ) -> Option<DMatrix<f64>> {
        let minus = self.cross_terms(directions)?;
        if !(0..minus.nrows()).any(|i| self.is_rough(i)) {
            return Some(minus);
        }
        let noise_floors = self.noise_floors(directions);
        // Four corners with weight 1/4: two standard deviations.
        let known_to = |i: usize, j: usize| noise_floors[i].hypot(noise_floors[j]);
        let significant = |i, j| above_noise(minus[(i, j)], known_to(i, j));
        Some(DMatrix::from_fn(minus.nrows(), minus.ncols(), significant))
    }

    /// Off-diagonal terms of the negative Hessian.
    fn cross_terms(&self, directions: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let p = self.free.len();
        let pairs: Vec<(usize, usize)> = (0..p).flat_map(|i| (0..i).map(move |j| (i, j))).collect();
        let corners = |&(i, j): &(usize, usize)| {
            let corner = |by, other| point(p, &[(i, by), (j, other)]);
            [corner(1.0, 1.0), corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)]
        };
        let nats = self.at(directions, &pairs.iter().flat_map(corners).collect::<Vec<_>>());
        let mut minus = DMatrix::zeros(p, p);
        for (corner, &(i, j)) in nats.chunks(4).zip(&pairs) {
            let mixed = 0.25 * (corner[2] + corner[3] - corner[0] - corner[1]);
            minus[(i, j)] = mixed;
            minus[(j, i)] = mixed;
        }
        minus.iter().all(|m| m.is_finite()).then_some(minus)
    }
}

/// Length factor for a direction whose drop is this share of its target.
fn length_factor(share: f64) -> f64 {
    if share * MAX_RESCALING_FACTOR * MAX_RESCALING_FACTOR > 1.0 {
        share.sqrt().recip().max(MAX_RESCALING_FACTOR.recip())
    } else {
        MAX_RESCALING_FACTOR
    }
}

/// Removes the expected noise from a value's square.
fn above_noise(value: f64, known_to: f64) -> f64 {
    if value.abs() <= known_to { 0.0 } else { value - known_to * known_to / value }
}

fn point(p: usize, by: &[(usize, f64)]) -> DVector<f64> {
    let mut point = DVector::zeros(p);
    by.iter().for_each(|&(i, far)| point[i] = far);
    point
}

/// The hypothesis with changed values, within their ranges.
pub(crate) fn moved(at: &Hypothesis, free: &[usize], change: &DVector<f64>) -> Hypothesis {
    let mut other = at.clone();
    for (&i, by) in free.iter().zip(change) {
        let [low, high] = other.ranges[i];
        other.values[i] = (other.values[i] + by).clamp(low, high);
    }
    other
}

fn means(nats: &[f64]) -> Vec<f64> {
    nats.chunks(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect()
}

/// Negative second derivatives from the two distances of [`PROBE_DISTANCES`]; the fit itself is
/// excluded, since a search ends on a noise peak.
pub(crate) fn curvatures([whole, half]: &[Vec<f64>; 2]) -> Vec<f64> {
    let squares = PROBE_DISTANCES[0] * PROBE_DISTANCES[0] - PROBE_DISTANCES[1] * PROBE_DISTANCES[1];
    whole.iter().zip(half).map(|(whole, half)| 2.0 * (half - whole) / squares).collect()
}

/// Scores of every cell at four points per direction.
pub(crate) struct CellProbes {
    /// Half differences of the two sides, one row per training cell, at both distances.
    odd: [DMatrix<f64>; 2],
    /// Means of the two sides over all cells, at both distances.
    pub(crate) even: [Vec<f64>; 2],
}

impl CellProbes {
    pub(crate) fn of(
        evidence: &Evidence,
        at: &Hypothesis,
        free: &[usize],
        directions: &DMatrix<f64>,
    ) -> Self {
        let p = free.len();
        let there = |(i, far)| moved(at, free, &(directions * point(p, &[(i, far)])));
        let of = |far: f64| {
            let asked: Vec<Hypothesis> =
                (0..p).flat_map(|i| [(i, far), (i, -far)]).map(there).collect();
            let cells = score_cells_of_each(evidence, &asked.iter().collect::<Vec<_>>());
            let training: Vec<usize> = cells[0].of(CellSet::Training).collect();
            let odd = DMatrix::from_fn(training.len(), p, |row, i| {
                let side = |n: usize| cells[2 * i + n].log_likelihood[training[row]];
                0.5 * (side(0) - side(1))
            });
            let nats: Vec<f64> = cells.iter().map(|cells| cells.total(CellSet::Training)).collect();
            (odd, means(&nats))
        };
        let [(whole, of_whole), (half, of_half)] = PROBE_DISTANCES.map(of);
        Self { odd: [whole, half], even: [of_whole, of_half] }
    }

    /// Slopes by least squares through both distances.
    pub(crate) fn slopes(&self) -> DMatrix<f64> {
        let squares: f64 = PROBE_DISTANCES.iter().map(|far| far * far).sum();
        (&self.odd[0] * PROBE_DISTANCES[0] + &self.odd[1] * PROBE_DISTANCES[1]) / squares
    }

    /// Noise variance of each slope, from the residuals over all directions. Outlying directions
    /// do not count for the others: for a nearly noise-free camera the threshold's slope is noisy
    /// while that of a rate is not.
    pub(crate) fn rough(&self) -> Vec<f64> {
        let [whole, half] = self.odd.each_ref().map(|odd| odd.row_sum());
        let left = whole - half * (PROBE_DISTANCES[0] / PROBE_DISTANCES[1]);
        // Variances: 0.4 of a probe's for the slope, 2.5 for the residual.
        let own: Vec<f64> = left.iter().map(|left| 0.4 / 2.5 * left * left).collect();
        let much = OUTLIER_RATIO * upper_median(&mut own.clone()).unwrap_or_default();
        let mean =
            |most: f64| own.iter().map(|own| own.min(most)).sum::<f64>() / own.len().max(1) as f64;
        // An outlier may come from a bent line: it counts as the mean of all at most.
        let (common, objection_to_all) = (mean(much), mean(f64::INFINITY));
        own.iter().map(|own| if *own > much { own.min(objection_to_all) } else { common }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_below_the_noise_floor_are_dropped() {
        assert_eq!([-3.0, 0.0, 2.9, 3.0].map(|value| above_noise(value, 3.0)), [0.0; 4]);
        // A square of 100 is 9 of noise and 91 of signal.
        assert!((above_noise(-10.0, 3.0) + 9.1).abs() < 1e-12);
        assert_eq!(above_noise(0.5, 0.0), 0.5, "no steps, nothing taken off");
        assert_eq!(above_noise(0.0, 0.0), 0.0);
    }

    #[test]
    fn a_direction_is_rescaled_to_its_drop_within_bounds() {
        // The drop grows with the square of the length; NaN is no drop.
        let shares = [1.0, 4.0, 0.25, 1e9, 1e-9, -3.0, f64::NAN];
        assert_eq!(shares.map(length_factor), [1.0, 0.5, 2.0, 0.2, 5.0, 5.0, 5.0]);
    }

    #[test]
    fn an_outlying_direction_does_not_affect_the_others() {
        // Residuals of 1 nat of either sign, and 300 along the fourth direction.
        let left = [1.0, -1.0, 1.0, 300.0, -1.0, 1.0];
        let row = |values: Vec<f64>| DMatrix::from_row_slice(1, 6, &values);
        let whole = row(left.iter().map(|left| 8.0 + left).collect());
        let four = CellProbes { odd: [whole, row(vec![4.0; 6])], even: Default::default() };
        let rough = four.rough();
        assert!((rough[3] - 0.16 * 90_005.0 / 6.0).abs() < 1e-6, "{rough:?}");
        for of_other in [0, 1, 2, 4, 5].map(|i| rough[i]) {
            assert!((0.16..0.7).contains(&of_other), "{rough:?}");
        }
    }
}
