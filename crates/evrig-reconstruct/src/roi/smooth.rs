//! Kalman smoother of the target's path.
//!
//! Each of the similarity's four parameters follows a white-jerk model (its third derivative is
//! white noise with an estimated density), so that the path between two knots is a quintic
//! polynomial with continuous acceleration. Each corner is observed at its own time. An extended
//! Kalman filter runs forwards and a Rauch-Tung-Striebel smoother backwards (Särkkä, "Bayesian
//! Filtering and Smoothing", 2013, sections 5.2 and 9.1); iterated, this is the Gauss-Newton
//! solution of the whole path. The densities are maximum-likelihood estimates.

use super::state::{Chart, Covariance, M, N, Numbers, SHAPE, State, numbers_after};
use nalgebra::{SMatrix, SVector};

/// Coordinates of four corners.
pub(super) type Corners = SVector<f64, 8>;
/// Their covariance.
pub(super) type CornersCovariance = SMatrix<f64, 8, 8>;

/// One detection in ideal pixels.
#[derive(Debug, Clone)]
pub(super) struct Observation {
    /// Seconds since the track's zero.
    pub(super) at_s: f64,
    /// Delay of each corner after `at_s`.
    pub(super) delays_s: [f64; 4],
    pub(super) corners: Corners,
    pub(super) covariance: CornersCovariance,
    /// The eight parameters of its own corners.
    pub(super) numbers: Numbers,
    /// Whether a new segment begins here.
    pub(super) is_start: bool,
}

/// Process noise densities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Jerk {
    /// Density of the jerk of scale and rotation (of the tag's half side), px^2/s^5.
    pub(super) turn: f64,
    /// Density of the jerk of the translation, px^2/s^5.
    pub(super) shift: f64,
    /// Growth of the shape's variance per second.
    pub(super) shape_per_s: f64,
}

/// State estimate and covariance.
#[derive(Debug, Clone)]
pub(super) struct Belief {
    pub(super) mean: State,
    pub(super) covariance: Covariance,
}

/// Result of the forward filter.
struct Forward {
    predicted: Vec<Belief>,
    filtered: Vec<Belief>,
    /// Squared normalised innovation of each detection; expected: 8.
    squares: Vec<f64>,
    /// Logarithm of the determinant of each innovation's covariance.
    log_determinants: Vec<f64>,
    /// Weight of each detection, at most 1.
    weights: Vec<f64>,
}

/// The smoother and its data.
pub(super) struct Smoother<'a> {
    pub(super) chart: Chart,
    pub(super) corners_mm: [[f64; 2]; 4],
    pub(super) observations: &'a [Observation],
}

/// A smoothed path.
pub(super) struct Smoothed {
    pub(super) beliefs: Vec<Belief>,
    /// Squared normalised leave-one-out residual of each detection; expected: 8.
    pub(super) squares: Vec<f64>,
    pub(super) residuals: Vec<Corners>,
}

/// Degrees of freedom of the Student-t weights used while outliers may be present.
const TAIL: f64 = 4.0;

/// Initial standard deviations: position, speed, acceleration in px and s, then foreshortening and
/// tilt.
const START: [f64; 5] = [300.0, 3000.0, 1e5, 0.3, 0.6];

impl Smoother<'_> {
    /// States at the detections' own parameters at rest: the first linearisation point.
    pub(super) fn first_guess(&self) -> Vec<State> {
        let mut shape = SVector::<f64, 4>::zeros();
        for observation in self.observations {
            shape += observation.numbers.rows(4, 4);
        }
        shape /= self.observations.len().max(1) as f64;
        let state = |observation: &Observation| {
            let mut state = State::zeros();
            state.rows_mut(0, 4).copy_from(&observation.numbers.rows(0, 4));
            state.rows_mut(SHAPE, 4).copy_from(&shape);
            state
        };
        self.observations.iter().map(state).collect()
    }

    /// The path linearised about `guess`; Student-t weights when `is_robust`.
    pub(super) fn smooth(&self, guess: &[State], jerk: Jerk, is_wary: bool) -> Option<Smoothed> {
        let forward = self.forward(guess, jerk, is_wary)?;
        let mut beliefs = forward.filtered.clone();
        for k in (0..beliefs.len().saturating_sub(1)).rev() {
            let step = self.transition(k + 1);
            let predicted = &forward.predicted[k + 1];
            let inverse = predicted.covariance.cholesky()?.inverse();
            let gain = forward.filtered[k].covariance * step.transpose() * inverse;
            let next = beliefs[k + 1].clone();
            let belief = &mut beliefs[k];
            belief.mean += gain * (next.mean - predicted.mean);
            let change = next.covariance - predicted.covariance;
            belief.covariance += gain * change * gain.transpose();
            symmetrise(&mut belief.covariance);
        }
        let mut smoothed = Smoothed { beliefs, squares: Vec::new(), residuals: Vec::new() };
        for (k, observation) in self.observations.iter().enumerate() {
            let belief = &smoothed.beliefs[k];
            let (expected, slope) = self.expect(&belief.mean, observation);
            let residual = observation.corners - expected;
            let spread = slope * belief.covariance * slope.transpose();
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
        guess: &[State],
        jerk: Jerk,
        is_wary: bool,
    ) -> Option<(f64, f64)> {
        let forward = self.forward(guess, jerk, is_wary)?;
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
        let misfit: f64 = if is_wary {
            squares.map(|square| (TAIL + 8.0) * (square / TAIL).ln_1p()).sum()
        } else {
            8.0 * n * factor.ln()
        };
        Some((-0.5 * (determinants + misfit), factor))
    }

    fn forward(&self, guess: &[State], jerk: Jerk, is_wary: bool) -> Option<Forward> {
        let n = self.observations.len();
        let mut forward = Forward {
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
            let weight = if is_wary { ((TAIL + 8.0) / (TAIL + square)).min(1.0) } else { 1.0 };
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
            forward.filtered.push(Belief { mean, covariance });
        }
        Some(forward)
    }

    fn predict(&self, k: usize, guess: &[State], last: Option<&Belief>, jerk: Jerk) -> Belief {
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
        Belief { mean, covariance }
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
    fn expect(&self, state: &State, observation: &Observation) -> (Corners, SMatrix<f64, 8, N>) {
        let mut corners = Corners::zeros();
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
    residual: &Corners,
    spread: &CornersCovariance,
    noise: &CornersCovariance,
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

fn start(guess: &State) -> Belief {
    let variance = |i: usize| match i {
        0..SHAPE => START[i / 4].powi(2),
        12 | 13 => START[3].powi(2),
        _ => START[4].powi(2),
    };
    let diagonal = State::from_fn(|i, _| variance(i));
    Belief { mean: *guess, covariance: Covariance::from_diagonal(&diagonal) }
}

fn add_jerk(covariance: &mut Covariance, dt: f64, jerk: Jerk) {
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
