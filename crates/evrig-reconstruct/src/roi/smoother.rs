//! Kalman smoother of the target's path.
//!
//! Each of the similarity's four parameters follows a white-jerk model (its third derivative is
//! white noise with an estimated density), so that the path between two knots is a quintic
//! polynomial with continuous acceleration. Each corner is observed at its own time. An extended
//! Kalman filter runs forwards and a Rauch-Tung-Striebel smoother backwards (Särkkä, "Bayesian
//! Filtering and Smoothing", 2013, sections 5.2 and 9.1); iterated, this is the Gauss-Newton
//! solution of the whole path. The densities are maximum-likelihood estimates.

use super::path_state::{Covariance, M, N, Numbers, PathChart, PathState, SHAPE, numbers_after};
use nalgebra::{SMatrix, SVector};

pub(super) type CornerVector = SVector<f64, 8>;
pub(super) type CornerCovariance = SMatrix<f64, 8, 8>;

#[derive(Debug, Clone)]
pub(super) struct Observation {
    /// Seconds since the track's zero.
    pub(super) at_s: f64,
    /// Delay of each corner after `at_s`.
    pub(super) delays_s: [f64; 4],
    pub(super) corners: CornerVector,
    pub(super) covariance: CornerCovariance,
    /// The eight parameters of its own corners.
    pub(super) numbers: Numbers,
    pub(super) is_start: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JerkDensity {
    /// Density of the jerk of scale and rotation (of the tag's half side), px^2/s^5.
    pub(super) turn: f64,
    /// Density of the jerk of the translation, px^2/s^5.
    pub(super) shift: f64,
    /// Growth of the shape's variance per second.
    pub(super) shape_per_s: f64,
}

#[derive(Debug, Clone)]
pub(super) struct StateEstimate {
    pub(super) mean: PathState,
    pub(super) covariance: Covariance,
}

struct ForwardFilter {
    predicted: Vec<StateEstimate>,
    filtered: Vec<StateEstimate>,
    /// Squared normalised innovation of each detection; expected: 8.
    squares: Vec<f64>,
    log_determinants: Vec<f64>,
    weights: Vec<f64>,
}

pub(super) struct Smoother<'a> {
    pub(super) chart: PathChart,
    pub(super) corners_mm: [[f64; 2]; 4],
    pub(super) observations: &'a [Observation],
}

pub(super) struct Smoothed {
    pub(super) estimates: Vec<StateEstimate>,
    /// Squared normalised leave-one-out residual of each detection; expected: 8.
    pub(super) squares: Vec<f64>,
    pub(super) residuals: Vec<CornerVector>,
}

/// Degrees of freedom of the Student-t weights used while outliers may be present.
const STUDENT_DOF: f64 = 4.0;
/// Initial standard deviations: position, speed, acceleration in px and s, then foreshortening and
/// tilt.
const INITIAL_SIGMAS: [f64; 5] = [300.0, 3000.0, 1e5, 0.3, 0.6];

impl Smoother<'_> {
    /// States at the detections' own parameters at rest: the first linearisation point.
    pub(super) fn first_guess(&self) -> Vec<PathState> {
        let mut shape = SVector::<f64, 4>::zeros();
        for observation in self.observations {
            shape += observation.numbers.rows(4, 4);
        }
        shape /= self.observations.len().max(1) as f64;
        let state = |observation: &Observation| {
            let mut state = PathState::zeros();
            state.rows_mut(0, 4).copy_from(&observation.numbers.rows(0, 4));
            state.rows_mut(SHAPE, 4).copy_from(&shape);
            state
        };
        self.observations.iter().map(state).collect()
    }

    /// The path linearised about `guess`; Student-t weights when `is_robust`.
    pub(super) fn smooth(
        &self,
        guess: &[PathState],
        jerk: JerkDensity,
        is_robust: bool,
    ) -> Option<Smoothed> {
        let forward = self.forward(guess, jerk, is_robust)?;
        let mut estimates = forward.filtered.clone();
        for k in (0..estimates.len().saturating_sub(1)).rev() {
            let step = self.transition(k + 1);
            let predicted = &forward.predicted[k + 1];
            let inverse = predicted.covariance.cholesky()?.inverse();
            let gain = forward.filtered[k].covariance * step.transpose() * inverse;
            let next = estimates[k + 1].clone();
            let estimate = &mut estimates[k];
            estimate.mean += gain * (next.mean - predicted.mean);
            let change = next.covariance - predicted.covariance;
            estimate.covariance += gain * change * gain.transpose();
            symmetrise(&mut estimate.covariance);
        }
        let mut smoothed = Smoothed { estimates, squares: Vec::new(), residuals: Vec::new() };
        for (k, observation) in self.observations.iter().enumerate() {
            let estimate = &smoothed.estimates[k];
            let (expected, slope) = self.expect(&estimate.mean, observation);
            let residual = observation.corners - expected;
            let spread = slope * estimate.covariance * slope.transpose();
            let weight = forward.weights[k];
            let square = square_without(&residual, &spread, &observation.covariance, weight)?;
            smoothed.squares.push(square);
            smoothed.residuals.push(residual);
        }
        Some(smoothed)
    }

    /// Log-likelihood of the detections, and the factor by which their covariances are too small.
    ///
    /// Student-t with the covariances as given when robust; otherwise normal with all covariances,
    /// including the jerk, scaled by the factor of greatest likelihood.
    pub(super) fn likelihood(
        &self,
        guess: &[PathState],
        jerk: JerkDensity,
        is_robust: bool,
    ) -> Option<(f64, f64)> {
        let forward = self.forward(guess, jerk, is_robust)?;
        // The first detections of a segment carry no information on its jerk: three parameters per
        // component.
        let mut since_start = 0;
        let counted: Vec<usize> = (0..forward.squares.len())
            .filter(|&k| {
                since_start = if self.observations[k].is_start { 0 } else { since_start + 1 };
                since_start > 2
            })
            .collect();
        let n = counted.len() as f64;
        if n < 1.0 {
            return Some((0.0, 1.0));
        }
        let determinants: f64 = counted.iter().map(|&k| forward.log_determinants[k]).sum();
        let squares = counted.iter().map(|&k| forward.squares[k]);
        let factor = squares.clone().sum::<f64>() / (8.0 * n);
        let misfit: f64 = if is_robust {
            squares.map(|square| (STUDENT_DOF + 8.0) * (square / STUDENT_DOF).ln_1p()).sum()
        } else {
            8.0 * n * factor.ln()
        };
        Some((-0.5 * (determinants + misfit), factor))
    }

    fn forward(
        &self,
        guess: &[PathState],
        jerk: JerkDensity,
        is_robust: bool,
    ) -> Option<ForwardFilter> {
        let n = self.observations.len();
        let mut forward = ForwardFilter {
            predicted: Vec::with_capacity(n),
            filtered: Vec::with_capacity(n),
            squares: Vec::with_capacity(n),
            log_determinants: Vec::with_capacity(n),
            weights: Vec::with_capacity(n),
        };
        for (k, observation) in self.observations.iter().enumerate() {
            let predicted = self.predict(k, guess, forward.filtered.last(), jerk);
            let (expected, slope) = self.expect(&guess[k], observation);
            let residual = observation.corners - expected - slope * (predicted.mean - guess[k]);
            let spread = slope * predicted.covariance * slope.transpose();
            let total = (spread + observation.covariance).cholesky()?;
            let square = residual.dot(&total.solve(&residual));
            let weight = if is_robust {
                ((STUDENT_DOF + 8.0) / (STUDENT_DOF + square)).min(1.0)
            } else {
                1.0
            };
            let noise = observation.covariance / weight;
            let weighed = (spread + noise).cholesky()?;
            let gain = weighed.solve(&(slope * predicted.covariance)).transpose();
            let keep = Covariance::identity() - gain * slope;
            let mut covariance =
                keep * predicted.covariance * keep.transpose() + gain * noise * gain.transpose();
            symmetrise(&mut covariance);
            let mean = predicted.mean + gain * residual;
            forward.squares.push(square);
            forward.weights.push(weight);
            forward.log_determinants.push(2.0 * total.l().diagonal().map(f64::ln).sum());
            forward.predicted.push(predicted);
            forward.filtered.push(StateEstimate { mean, covariance });
        }
        Some(forward)
    }

    fn predict(
        &self,
        k: usize,
        guess: &[PathState],
        last: Option<&StateEstimate>,
        jerk: JerkDensity,
    ) -> StateEstimate {
        let Some(last) = last else { return start(&guess[k]) };
        let step = self.transition(k);
        let mut mean = step * last.mean;
        let mut covariance = step * last.covariance * step.transpose();
        let dt = self.observations[k].at_s - self.observations[k - 1].at_s;
        if self.observations[k].is_start {
            let fresh = start(&guess[k]);
            mean.rows_mut(0, SHAPE).copy_from(&fresh.mean.rows(0, SHAPE));
            for i in 0..SHAPE {
                covariance[(i, i)] = fresh.covariance[(i, i)];
            }
        } else {
            add_jerk(&mut covariance, dt, jerk);
        }
        for i in SHAPE..N {
            covariance[(i, i)] += jerk.shape_per_s * dt;
        }
        StateEstimate { mean, covariance }
    }

    /// Transition from the state before detection `k`; identity at a segment start.
    fn transition(&self, k: usize) -> Covariance {
        let mut step = Covariance::identity();
        if self.observations[k].is_start {
            step.fill_with_identity();
            for i in 0..SHAPE {
                step[(i, i)] = 0.0;
            }
            return step;
        }
        let dt = self.observations[k].at_s - self.observations[k - 1].at_s;
        for i in 0..4 {
            step[(i, 4 + i)] = dt;
            step[(i, 8 + i)] = dt * dt / 2.0;
            step[(4 + i, 8 + i)] = dt;
        }
        step
    }

    /// Expected corners of a state at their times, and their derivatives.
    fn expect(
        &self,
        state: &PathState,
        observation: &Observation,
    ) -> (CornerVector, SMatrix<f64, 8, N>) {
        let mut corners = CornerVector::zeros();
        let mut slope = SMatrix::<f64, 8, N>::zeros();
        for (i, point) in self.corners_mm.iter().enumerate() {
            let (numbers, by_state) = numbers_after(state, observation.delays_s[i]);
            let (image, by_numbers) = self.chart.project(&numbers, *point);
            corners[2 * i] = image[0];
            corners[2 * i + 1] = image[1];
            let by_numbers: SMatrix<f64, 2, M> = by_numbers;
            slope.fixed_view_mut::<2, N>(2 * i, 0).copy_from(&(by_numbers * by_state));
        }
        (corners, slope)
    }
}

/// Squared leave-one-out residual of a detection, from its residual against the path it is part of
/// with a weight, and the path's covariance there.
///
/// With `W` the weighted noise and `P` the path's covariance, the leave-one-out residual is `W (W -
/// P)^-1 r` with covariance `W (W - P)^-1 W - W` from the others.
fn square_without(
    residual: &CornerVector,
    spread: &CornerCovariance,
    noise: &CornerCovariance,
    weight: f64,
) -> Option<f64> {
    let weighed = noise / weight;
    // A detection that alone determines the path has no leave-one-out residual.
    let Some(rest) = (weighed - spread).cholesky() else { return Some(0.0) };
    let miss = weighed * rest.solve(residual);
    let own = weighed * rest.solve(&weighed) - weighed;
    let total = ((own + own.transpose()) * 0.5 + noise).cholesky()?;
    Some(miss.dot(&total.solve(&miss)))
}

fn start(guess: &PathState) -> StateEstimate {
    let variance = |i: usize| match i {
        0..SHAPE => INITIAL_SIGMAS[i / 4].powi(2),
        12 | 13 => INITIAL_SIGMAS[3].powi(2),
        _ => INITIAL_SIGMAS[4].powi(2),
    };
    let diagonal = PathState::from_fn(|i, _| variance(i));
    StateEstimate { mean: *guess, covariance: Covariance::from_diagonal(&diagonal) }
}

fn add_jerk(covariance: &mut Covariance, dt: f64, jerk: JerkDensity) {
    let powers = [
        [dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0],
        [dt.powi(4) / 8.0, dt.powi(3) / 3.0, dt.powi(2) / 2.0],
        [dt.powi(3) / 6.0, dt.powi(2) / 2.0, dt],
    ];
    for i in 0..4 {
        let density = if i < 2 { jerk.turn } else { jerk.shift };
        for (row, parts) in powers.iter().enumerate() {
            for (column, part) in parts.iter().enumerate() {
                covariance[(4 * row + i, 4 * column + i)] += density * part;
            }
        }
    }
}

fn symmetrise(covariance: &mut Covariance) {
    *covariance = (*covariance + covariance.transpose()) * 0.5;
}
