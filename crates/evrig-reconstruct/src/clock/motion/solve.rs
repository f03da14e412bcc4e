//! Joint Gauss-Newton fit of path, geometry and time.
//!
//! Residuals are weighted by Huber's rule, and outliers are dropped. The information on the offset
//! is then assessed: the loss to unknown geometry and the part due to noise of the path.

use super::banded::Factor;
use super::coarse::CoarseStart;
use super::equations::{
    ImageJacobian, Information, KAPPA, LN_SCALE, MotionEquations, MotionState, N, ROLL,
    ReducedMotion, TAU, advance, apply, invert, solve,
};
use super::path::PathSpline;
use super::samples::{MotionOptions, TrackPoint};
use crate::clock::error::ClockError;
use evrig_core::stats::Estimate;
use nalgebra::SVector;

pub(super) const MAX_STEPS: usize = 40;
/// Huber threshold in standard errors.
const HUBER_ERRORS: f64 = 3.0;
/// Outlier threshold in standard errors.
const OUTLIER_ERRORS: f64 = 8.0;
/// Time over which errors are clustered, seconds.
const CLUSTER_S: f64 = 0.25;
/// Steps before outliers are dropped instead of down-weighted.
const OUTLIER_STEPS: usize = 4;

pub(super) struct Solver<'a> {
    reference: &'a [TrackPoint],
    other: &'a [TrackPoint],
    fits_skew: bool,
    /// Roll and its standard error in radians.
    roll: Option<[f64; 2]>,
    middle_s: f64,
}

/// Result of the fit; times in seconds, roll in radians.
#[derive(Debug, Clone)]
pub(super) struct MotionFit {
    pub(super) tau_s: f64,
    pub(super) kappa: f64,
    pub(super) ln_scale: f64,
    pub(super) roll: f64,
    pub(super) sigma_tau_s: f64,
    pub(super) sigma_kappa: f64,
    pub(super) sigma_ln_scale: f64,
    pub(super) sigma_roll: f64,
    pub(super) limit_s: f64,
    pub(super) limit_known_s: f64,
    pub(super) ratio: f64,
    /// The ratio with the information reduced by three standard deviations of the path's noise.
    pub(super) ratio_at_least: f64,
    pub(super) chi2_per_dof: f64,
    /// Mean squared residual over the variance of the other's positions.
    pub(super) unexplained: f64,
    pub(super) knot_s: f64,
    pub(super) middle_s: f64,
    /// Of the reference's samples, then the other's.
    pub(super) is_outlier: Vec<bool>,
    pub(super) is_converged: bool,
}

impl<'a> Solver<'a> {
    pub(super) fn new(
        reference: &'a [TrackPoint],
        other: &'a [TrackPoint],
        options: &MotionOptions,
    ) -> Self {
        let radians = |prior: Estimate| [prior.value, prior.standard_error].map(f64::to_radians);
        let middle_s = other.iter().map(|point| point.t_s).sum::<f64>() / other.len() as f64;
        let roll = options.roll_deg.map(radians);
        Self { reference, other, fits_skew: options.fits_skew, roll, middle_s }
    }

    /// Fits from `start` with the knot spacing suited to both tracks.
    ///
    /// `path`'s spacing was chosen for the reference alone. The other track may be more precise,
    /// and then too stiff a path leaves residuals: the spacing is halved while Akaike's criterion
    /// improves.
    pub(super) fn run(
        &self,
        path: PathSpline,
        start: CoarseStart,
    ) -> Result<MotionFit, ClockError> {
        let [x, y] = start.shift;
        let theta = SVector::from([start.tau_s, 0.0, start.ln_scale, start.roll, x, y]);
        let (mut state, mut is_converged) =
            self.iterate(MotionState { path, theta, centre: start.centre })?;
        let mut best = self.criterion(&state);
        let n = self.reference.len().max(self.other.len());
        while let Some(path) = state.path.finer(self.reference, n) {
            let Ok((finer, is_finer_converged)) =
                self.iterate(MotionState { path, ..state.clone() })
            else {
                break;
            };
            let criterion = self.criterion(&finer);
            if criterion >= best {
                break;
            }
            (state, is_converged, best) = (finer, is_finer_converged, criterion);
        }
        Ok(MotionFit { is_converged, ..self.finish(&state) })
    }

    /// Iterates until the offset converges. It does not where the motion carries no information on
    /// it: check the information first.
    fn iterate(&self, mut state: MotionState) -> Result<(MotionState, bool), ClockError> {
        for step in 0..MAX_STEPS {
            let residuals = self.residuals(&state);
            let weights = self.weights(&residuals, step);
            let reduced = self.equations(&state, &residuals, &weights).reduce();
            let Some(change) = solve(&reduced.information, &reduced.right) else {
                return Ok((state, true));
            };
            advance(&mut state, &reduced, &change);
            if !state.theta.iter().all(|value| value.is_finite()) {
                return Err(ClockError::NotConverged { steps: step + 1 });
            }
            if step > OUTLIER_STEPS && change[TAU].abs() < 1e-8 {
                return Ok((state, true));
            }
        }
        Ok((state, false))
    }

    /// Akaike's criterion with unknown error; outliers count with their weights.
    fn criterion(&self, state: &MotionState) -> f64 {
        let residuals = self.residuals(state);
        let weights = self.weights(&residuals, OUTLIER_STEPS);
        let chi2 = sum_of_squares(&residuals, &weights);
        let n = 2.0 * residuals.len() as f64;
        n * (chi2 / n).max(1e-12).ln() + 4.0 * state.path.n() as f64
    }

    /// Measured minus expected, reference first.
    fn residuals(&self, state: &MotionState) -> Vec<[f64; 2]> {
        let m = state.matrix();
        let own = self.reference.iter().map(|point| {
            let q = state.path.position(&state.path.basis(point.t_s));
            [point.p[0] - q[0], point.p[1] - q[1]]
        });
        let other = self.other.iter().map(|point| {
            let q = state.path.position(&state.place(point.t_s, self.middle_s));
            let seen = apply(m, [q[0] - state.centre[0], q[1] - state.centre[1]]);
            [point.p[0] - seen[0] - state.theta[4], point.p[1] - seen[1] - state.theta[5]]
        });
        own.chain(other).collect()
    }

    /// Weight of each sample: its inverse variance, reduced for outliers.
    fn weights(&self, residuals: &[[f64; 2]], step: usize) -> Vec<f64> {
        let points = self.reference.iter().chain(self.other);
        let sizes: Vec<f64> =
            points.clone().zip(residuals).map(|(p, r)| r[0].hypot(r[1]) / p.error).collect();
        // The median length of a standard normal pair is sqrt(2 ln 2).
        let mut sorted = sizes.clone();
        let middle = sorted.len() / 2;
        let median = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
        let scale = (median / (2.0 * std::f64::consts::LN_2).sqrt()).max(1.0);
        let weight = |(point, size): (&TrackPoint, &f64)| {
            let factor = match size / scale {
                far if far > OUTLIER_ERRORS && step >= OUTLIER_STEPS => 0.0,
                far if far > HUBER_ERRORS => HUBER_ERRORS / far,
                _ => 1.0,
            };
            factor / (point.error * point.error)
        };
        points.zip(&sizes).map(weight).collect()
    }

    fn equations(
        &self,
        state: &MotionState,
        residuals: &[[f64; 2]],
        weights: &[f64],
    ) -> MotionEquations {
        let mut equations = MotionEquations::new(state.path.n());
        let (own, others) = residuals.split_at(self.reference.len());
        let (own_weights, other_weights) = weights.split_at(self.reference.len());
        for ((point, r), w) in self.reference.iter().zip(own).zip(own_weights) {
            equations.add_reference(&state.path.basis(point.t_s), *r, *w);
        }
        for ((point, r), w) in self.other.iter().zip(others).zip(other_weights) {
            let basis = state.place(point.t_s, self.middle_s);
            let jacobian = ImageJacobian::new(state, point.t_s - self.middle_s, &basis);
            equations.add_other(&jacobian, &basis, *r, *w);
        }
        equations.add_penalty(&state.path);
        if let Some([roll, error]) = self.roll {
            let off = (roll - state.theta[ROLL] + std::f64::consts::PI)
                .rem_euclid(std::f64::consts::TAU)
                - std::f64::consts::PI;
            equations.corner[(ROLL, ROLL)] += error.powi(-2);
            equations.corner_right[ROLL] += off * error.powi(-2);
        }
        if !self.fits_skew {
            equations.fix(KAPPA);
        }
        equations
    }

    fn finish(&self, state: &MotionState) -> MotionFit {
        let residuals = self.residuals(state);
        let weights = self.weights(&residuals, OUTLIER_STEPS);
        let reduced = self.equations(state, &residuals, &weights).reduce();
        let Some(covariance) = invert(&reduced.information) else { return self.singular(state) };
        let chi2 = sum_of_squares(&residuals, &weights);
        let n_used = weights.iter().filter(|weight| **weight > 0.0).count();
        let dof = (2.0 * n_used as f64 - 2.0 * state.path.n() as f64 - N as f64).max(1.0);
        let inflation = (chi2 / dof).max(1.0).sqrt();
        let clustered =
            self.clustered_variances(state, &residuals, &weights, &reduced, &covariance);
        // The larger of both estimates.
        let sigma = |index: usize| {
            (inflation * covariance[(index, index)].sqrt()).max(clustered[index].sqrt())
        };
        let limit_s = covariance[(TAU, TAU)].sqrt();
        let limit_known_s = reduced.information[(TAU, TAU)].sqrt().recip();
        // Share of the offset's information left with unknown geometry, and the share due to noise
        // of the path's velocity.
        let share = (limit_known_s / limit_s).powi(2);
        let noise = self.noise_share(state, &reduced.factor);
        let scatter = 3.0 * noise / (state.path.n() as f64).sqrt();
        let ratio = |share: f64| if share > 0.0 { share.sqrt().recip() } else { f64::INFINITY };
        MotionFit {
            sigma_tau_s: sigma(TAU),
            sigma_kappa: sigma(KAPPA),
            sigma_ln_scale: sigma(LN_SCALE),
            sigma_roll: sigma(ROLL),
            limit_s,
            limit_known_s,
            ratio: ratio(share - noise),
            ratio_at_least: ratio(share - noise - scatter),
            chi2_per_dof: chi2 / dof,
            unexplained: self.unexplained(&residuals[self.reference.len()..], &weights),
            is_outlier: weights.iter().map(|weight| *weight == 0.0).collect(),
            ..self.singular(state)
        }
    }

    /// Variances with residuals clustered over [`CLUSTER_S`]: a corner's error depends on its
    /// position among the pixels, and the tag takes a while to cross one.
    ///
    /// Sandwich estimator (White; Liang and Zeger) with the correction for few clusters.
    fn clustered_variances(
        &self,
        state: &MotionState,
        residuals: &[[f64; 2]],
        weights: &[f64],
        reduced: &ReducedMotion,
        covariance: &Information,
    ) -> SVector<f64, N> {
        let begin_s = self.reference[0].t_s;
        let mut clusters = std::collections::BTreeMap::new();
        let mut add = |t_s: f64, score: SVector<f64, N>| {
            let cluster = ((t_s - begin_s) / CLUSTER_S).floor() as i64;
            *clusters.entry(cluster).or_insert_with(SVector::zeros) += covariance * score;
        };
        let (own, others) = residuals.split_at(self.reference.len());
        let (own_weights, other_weights) = weights.split_at(self.reference.len());
        for ((point, r), w) in self.reference.iter().zip(own).zip(own_weights) {
            let basis = state.path.basis(point.t_s);
            add(point.t_s, reduced.score(&basis, [w * r[0], w * r[1]]));
        }
        for ((point, r), w) in self.other.iter().zip(others).zip(other_weights) {
            let basis = state.place(point.t_s, self.middle_s);
            let jacobian = ImageJacobian::new(state, point.t_s - self.middle_s, &basis);
            let own = jacobian.by[0] * (w * r[0]) + jacobian.by[1] * (w * r[1]);
            let onto_path = [0, 1].map(|axis| {
                w * (jacobian.matrix[0][axis] * r[0] + jacobian.matrix[1][axis] * r[1])
            });
            add(point.t_s, own + reduced.score(&basis, onto_path));
        }
        let n = clusters.len() as f64;
        let squares: SVector<f64, N> = clusters.values().map(|p| p.component_mul(p)).sum();
        if n > 2.0 { squares * (n / (n - 1.0)) } else { squares }
    }

    /// Unexplained share of the other's motion, without outliers.
    fn unexplained(&self, residuals: &[[f64; 2]], weights: &[f64]) -> f64 {
        let used = self.other.iter().zip(residuals).zip(&weights[self.reference.len()..]);
        let used: Vec<_> = used.filter(|(_, w)| **w > 0.0).map(|(pair, _)| pair).collect();
        let n = used.len() as f64;
        let middle = [0, 1].map(|axis| used.iter().map(|(p, _)| p.p[axis]).sum::<f64>() / n);
        let of = |v: [f64; 2]| v[0] * v[0] + v[1] * v[1];
        let left: f64 = used.iter().map(|(_, r)| of(**r)).sum();
        let all: f64 = used.iter().map(|(p, _)| of([p.p[0] - middle[0], p.p[1] - middle[1]])).sum();
        left / all.max(f64::MIN_POSITIVE)
    }

    /// Variance of the path's velocity over its mean square, at some of the other's samples.
    fn noise_share(&self, state: &MotionState, factor: &Factor) -> f64 {
        const PLACES: usize = 64;
        let stride = self.other.len().div_ceil(PLACES);
        let (mut variance, mut square) = (0.0, 0.0);
        for point in self.other.iter().step_by(stride) {
            let basis = state.place(point.t_s, self.middle_s);
            let mut column = vec![0.0; state.path.n()];
            column[basis.first..basis.first + 4].copy_from_slice(&basis.slope);
            factor.solve(&mut column);
            let own = &column[basis.first..basis.first + 4];
            variance += 2.0 * own.iter().zip(basis.slope).map(|(a, b)| a * b).sum::<f64>();
            let v = state.path.velocity(&basis);
            square += v[0] * v[0] + v[1] * v[1];
        }
        if square > 0.0 { variance / square } else { f64::INFINITY }
    }

    /// The state with infinite errors.
    fn singular(&self, state: &MotionState) -> MotionFit {
        MotionFit {
            tau_s: state.theta[TAU],
            kappa: state.theta[KAPPA],
            ln_scale: state.theta[LN_SCALE],
            roll: state.theta[ROLL],
            sigma_tau_s: f64::INFINITY,
            sigma_kappa: f64::INFINITY,
            sigma_ln_scale: f64::INFINITY,
            sigma_roll: f64::INFINITY,
            limit_s: f64::INFINITY,
            limit_known_s: f64::NAN,
            ratio: f64::INFINITY,
            ratio_at_least: f64::INFINITY,
            chi2_per_dof: f64::NAN,
            unexplained: f64::NAN,
            knot_s: state.path.knot_s,
            middle_s: self.middle_s,
            is_outlier: vec![false; self.reference.len() + self.other.len()],
            is_converged: true,
        }
    }
}

fn sum_of_squares(residuals: &[[f64; 2]], weights: &[f64]) -> f64 {
    residuals.iter().zip(weights).map(|(r, w)| w * (r[0] * r[0] + r[1] * r[1])).sum()
}
