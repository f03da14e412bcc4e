//! Fits an effect's parameters along its profile: the constants follow to first order.
//!
//! Around the maximum of the constants, a step `de` of the effect moves that maximum by
//! `-inverse(I_cc) I_ce de`. So a step costs two evaluations per parameter and none per constant.

use crate::diagnose::Evidence;
use crate::diagnose::fit::optimizer::{ModelEvaluation, ModelFit, objective};
use crate::diagnose::fit::score_scan::ScoreScan;
use crate::diagnose::model::camera_model::{CameraModel, FitCoordinate};
use nalgebra::{DMatrix, DVector};

/// A coordinate of the effect and how the constants follow it.
struct ProfileDirection {
    at: usize,
    response: DVector<f64>,
}

/// Derivatives along the directions.
struct ProfileSlope {
    directions: Vec<ProfileDirection>,
    gradient: DVector<f64>,
    information: DMatrix<f64>,
}

impl ProfileSlope {
    fn at(
        evidence: &Evidence,
        scan: &ScoreScan<'_>,
        (model, evaluation): (&CameraModel, &ModelEvaluation),
        coordinates: &[FitCoordinate],
        own: &[usize],
        follow: bool,
    ) -> Self {
        let inverse = scan.inverse_without(own);
        let mut directions: Vec<ProfileDirection> = Vec::new();
        let mut rows: Vec<Vec<Vec<f64>>> = Vec::new();
        let mut gradient = Vec::new();
        for at in own.iter().copied().filter(|at| coordinates[*at].sd > 0.0) {
            let FitCoordinate { step, range, .. } = coordinates[at];
            let step = if model.values[at] + step > range[1] { -step } else { step };
            let mut other = model.clone();
            other.values[at] += step;
            let mut there = scan.evaluate(&other);
            let mut response = DVector::zeros(scan.active().len());
            if follow {
                let cross = scan.cross_information(&there, evaluation, step);
                response = -(&inverse * cross);
                for (constant, follows) in scan.active().iter().zip(response.iter()) {
                    other.values[*constant] += step * follows;
                }
                there = scan.evaluate(&other);
            }
            let (derivative, mut slope) = there.derivative(evidence, evaluation, step);
            slope += (other.log_prior(coordinates) - model.log_prior(coordinates)) / step;
            rows.push(derivative);
            gradient.push(slope);
            directions.push(ProfileDirection { at, response });
        }
        let k = directions.len();
        let information = DMatrix::from_fn(k, k, |i, j| {
            rows[i].iter().flatten().zip(rows[j].iter().flatten()).map(|(a, b)| a * b).sum()
        });
        Self { directions, gradient: DVector::from_vec(gradient), information }
    }

    /// The model after a damped step.
    fn stepped(
        &self,
        scan: &ScoreScan<'_>,
        model: &CameraModel,
        coordinates: &[FitCoordinate],
        damping: f64,
    ) -> Option<CameraModel> {
        let mut damped = self.information.clone();
        for j in 0..damped.nrows() {
            damped[(j, j)] += damping * damped[(j, j)].max(1e-9);
        }
        let step = damped.cholesky()?.solve(&self.gradient);
        let mut trial = model.clone();
        for (direction, step) in self.directions.iter().zip(step.iter()) {
            let [low, high] = coordinates[direction.at].range;
            let now = trial.values[direction.at];
            let moved = (now + step).clamp(low, high);
            trial.values[direction.at] = moved;
            for (constant, follows) in scan.active().iter().zip(direction.response.iter()) {
                trial.values[*constant] += (moved - now) * follows;
            }
        }
        for (value, coordinate) in trial.values.iter_mut().zip(coordinates) {
            *value = value.clamp(coordinate.range[0], coordinate.range[1]);
        }
        Some(trial)
    }
}

/// Fits the coordinates `own` of a model whose constants are otherwise those of the scan.
pub(crate) fn fit_profile(
    evidence: &Evidence,
    scan: &ScoreScan<'_>,
    start: CameraModel,
    own: &[usize],
    max_steps: usize,
) -> ModelFit {
    let coordinates = start.coordinates(evidence);
    let mut model = start;
    let mut evaluation = scan.evaluate(&model);
    let mut best = objective(evidence, &model, &evaluation, &coordinates);
    let mut damping = 1e-2;
    // Far from the maximum the first order of the constants is of no use.
    let mut follow = false;
    for _ in 0..max_steps {
        let slope =
            ProfileSlope::at(evidence, scan, (&model, &evaluation), &coordinates, own, follow);
        let mut improved = 0.0;
        for _ in 0..5 {
            let Some(trial) = slope.stepped(scan, &model, &coordinates, damping) else { break };
            let there = scan.evaluate(&trial);
            let q = objective(evidence, &trial, &there, &coordinates);
            if q.is_finite() && q > best {
                improved = q - best;
                (best, model, evaluation) = (q, trial, there);
                damping = (damping / 10.0_f64).max(1e-6);
                break;
            }
            damping *= 10.0;
        }
        if improved < 0.5 {
            if follow {
                break;
            }
            (follow, damping) = (true, 1e-2);
        }
    }
    ModelFit { model, evaluation, covariance: None, active: Vec::new() }
}
