//! Smoothing: from sightings with noise to the most probable path and its error.
//!
//! Each of the similarity's four numbers moves with white jerk (its third derivative is white noise
//! of a density that is estimated), so the path between two knots is a polynomial of fifth degree
//! with continuous acceleration. Each corner is observed at its own time. An extended Kalman filter
//! runs forwards and a Rauch-Tung-Striebel smoother backwards (Särkkä, "Bayesian Filtering and
//! Smoothing", 2013, sections 5.2 and 9.1); repeated about its own result, this is the Gauss-Newton
//! solution of the whole path. The densities are those of greatest likelihood.

use super::state::{Chart, Covariance, M, N, Numbers, SHAPE, State, numbers_after};
use nalgebra::{SMatrix, SVector};

/// Coordinates of four corners.
pub(super) type Corners = SVector<f64, 8>;
/// Their covariance.
pub(super) type CornersCovariance = SMatrix<f64, 8, 8>;

/// One sighting in ideal pixels.
#[derive(Debug, Clone)]
pub(super) struct Observation {
    /// Seconds since the track's zero.
    pub(super) at_s: f64,
    /// Of each corner after `at_s`.
    pub(super) delays_s: [f64; 4],
    pub(super) corners: Corners,
    pub(super) covariance: CornersCovariance,
    /// The eight numbers of its own four corners.
    pub(super) numbers: Numbers,
    /// No path leads here from the one before.
    pub(super) is_start: bool,
}

/// Strength of what moves the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Jerk {
    /// Density of the jerk of scale and turn (of the tag's half side), px^2/s^5.
    pub(super) turn: f64,
    /// Density of the jerk of the shift, px^2/s^5.
    pub(super) shift: f64,
    /// Variance that the shape gains in a second.
    pub(super) shape_per_s: f64,
}

/// A state with its error.
#[derive(Debug, Clone)]
pub(super) struct Belief {
    pub(super) mean: State,
    pub(super) covariance: Covariance,
}

/// One run forwards.
struct Forward {
    predicted: Vec<Belief>,
    filtered: Vec<Belief>,
    /// Squared innovation of each sighting in its own standard deviations; expected: 8.
    squares: Vec<f64>,
    /// Logarithm of the determinant of each innovation's covariance.
    log_determinants: Vec<f64>,
    /// By how much each sighting counted, 1 at most.
    weights: Vec<f64>,
}

/// The model that sightings are explained by.
pub(super) struct Smoother<'a> {
    pub(super) chart: Chart,
    pub(super) corners_mm: [[f64; 2]; 4],
    pub(super) observations: &'a [Observation],
}

/// A smoothed path.
pub(super) struct Smoothed {
    pub(super) beliefs: Vec<Belief>,
    /// Squared distance of each sighting from where all the others expect it, in standard
    /// deviations of that; expected: 8.
    pub(super) squares: Vec<f64>,
    pub(super) residuals: Vec<Corners>,
}

/// Degrees of freedom of the heavy-tailed law by which sightings are weighed while outliers may
/// still be among them.
const TAIL: f64 = 4.0;

/// Standard deviations of what is not known at a start: places, speeds, accelerations in px and s,
/// then foreshortening and tilt.
const START: [f64; 5] = [300.0, 3000.0, 1e5, 0.3, 0.6];

impl Smoother<'_> {
    /// States at the sightings' own numbers, standing still: where the first run is linearised.
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

    /// The path about `guess`; sightings far off count less when `is_wary`.
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

    /// Log-likelihood of the sightings, and the factor by which their covariances are too small.
    ///
    /// When wary, a heavy-tailed law with the covariances as they are; else the normal law with all
    /// covariances, the jerk's included, multiplied by the factor that suits best.
    pub(super) fn likelihood(
        &self,
        guess: &[State],
        jerk: Jerk,
        is_wary: bool,
    ) -> Option<(f64, f64)> {
        let forward = self.forward(guess, jerk, is_wary)?;
        // The first sightings of a stretch say nothing about its jerk: three numbers a component.
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

    /// From the state before sighting `k` to the one at it; what moves starts afresh at a start.
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

    /// The corners a state shows at their times, and how they depend on it.
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

/// Squared distance of a sighting from where the others expect it, from its residual against the
/// path in which it took part with a weight, and that path's covariance there.
///
/// With `W` the weighed noise and `P` the spread, the others alone are off by `W (W - P)^-1 r`,
/// with the covariance `W (W - P)^-1 W - W` of their own.
fn square_without(
    residual: &Corners,
    spread: &CornersCovariance,
    noise: &CornersCovariance,
    weight: f64,
) -> Option<f64> {
    let weighed = noise / weight;
    // Where the sighting alone carries the path, nothing is left to compare it with.
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
