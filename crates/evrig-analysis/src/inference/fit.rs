//! Levenberg-Marquardt on the penalised log-likelihood.

use super::model::{CameraModel, FitCoordinate, PixelTerms, score_view};
use crate::diagnose::Evidence;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Scores of all pixels under a model.
#[derive(Debug, Clone)]
pub(crate) struct ModelEvaluation {
    pub(crate) pixels: Vec<PixelTerms>,
}

impl ModelEvaluation {
    pub(crate) fn of(evidence: &Evidence, model: &CameraModel) -> Self {
        let n = evidence.pixels.len();
        Self { pixels: (0..n).into_par_iter().map(|p| model.score(evidence, p, None)).collect() }
    }

    /// Log-likelihood and events per cell: tile and block.
    pub(crate) fn cells(&self, evidence: &Evidence) -> Vec<[f64; 2]> {
        let nb = evidence.blocks.n();
        let mut cells = vec![[0.0; 2]; evidence.n_tiles * nb];
        for (pixel, score) in evidence.pixels.iter().zip(&self.pixels) {
            for (b, c) in score.compensator.iter().enumerate() {
                cells[pixel.tile * nb + b][0] -= c;
            }
            for (l, b) in score.log_hazard.iter().zip(&score.block) {
                let cell = &mut cells[pixel.tile * nb + usize::from(*b)];
                cell[0] += l;
                cell[1] += 1.0;
            }
        }
        cells
    }

    pub(crate) fn sum(&self, evidence: &Evidence, is_train: impl Fn(usize, usize) -> bool) -> f64 {
        let nb = evidence.blocks.n();
        self.cells(evidence)
            .iter()
            .enumerate()
            .filter(|(i, _)| is_train(i / nb, i % nb))
            .map(|(_, c)| c[0])
            .sum()
    }
}

/// Mean and standard error of the difference of two evaluations on held-out cells, per event.
pub(crate) fn paired_gain(
    evidence: &Evidence,
    a: &ModelEvaluation,
    b: &ModelEvaluation,
    held: bool,
) -> (f64, f64) {
    let nb = evidence.blocks.n();
    let (ca, cb) = (a.cells(evidence), b.cells(evidence));
    let picked: Vec<(f64, f64)> = (0..ca.len())
        .filter(|i| evidence.is_held_out(i / nb, i % nb) == held && ca[*i][1] + cb[*i][1] > 0.0)
        .map(|i| (ca[i][0] - cb[i][0], ca[i][1]))
        .collect();
    let n: f64 = picked.iter().map(|p| p.1).sum();
    let d: f64 = picked.iter().map(|p| p.0).sum();
    let mean = d / n.max(1.0);
    let k = picked.len() as f64;
    let var: f64 =
        picked.iter().map(|(d, n)| (d - mean * n).powi(2)).sum::<f64>() * k / (k - 1.0).max(1.0);
    (mean, var.sqrt() / n.max(1.0))
}

#[derive(Debug, Clone)]
pub(crate) struct ModelFit {
    pub(crate) model: CameraModel,
    pub(crate) evaluation: ModelEvaluation,
    /// Inverse of the information, and the active coordinates.
    pub(crate) covariance: Option<DMatrix<f64>>,
    pub(crate) active: Vec<usize>,
}

struct LikelihoodSlope {
    gradient: DVector<f64>,
    information: DMatrix<f64>,
}

impl ModelFit {
    /// Log-likelihood of the training cells.
    pub(crate) fn training(&self, evidence: &Evidence) -> f64 {
        self.evaluation.sum(evidence, |tile, block| !evidence.is_held_out(tile, block))
    }
}

fn objective(
    evidence: &Evidence,
    model: &CameraModel,
    e: &ModelEvaluation,
    c: &[FitCoordinate],
) -> f64 {
    e.sum(evidence, |t, b| !evidence.is_held_out(t, b)) + model.log_prior(c)
}

/// Terms of a pixel with one coordinate stepped, inwards from a bound, and the step. `signal` is that
/// of the model.
pub(super) fn stepped(
    evidence: &Evidence,
    model: &CameraModel,
    (at, coordinate): (usize, &FitCoordinate),
    p: usize,
    signal: &[f64],
) -> (PixelTerms, f64) {
    let FitCoordinate { step, range, changes_signal, .. } = *coordinate;
    let mut other = model.clone();
    let h = if other.values[at] + step > range[1] { -step } else { step };
    other.values[at] += h;
    let keeps_signal = !changes_signal && !needs_signal(model, at);
    (other.score(evidence, p, keeps_signal.then(|| signal.to_vec())), h)
}

/// Gradient and event information of the training cells, by forward differences.
fn slope(
    evidence: &Evidence,
    model: &CameraModel,
    coordinates: &[FitCoordinate],
    active: &[usize],
) -> LikelihoodSlope {
    let k = active.len();
    let (mut gradient, mut information) = (0..evidence.pixels.len())
        .into_par_iter()
        .map(|p| {
            let view = model.view(evidence, p, None);
            let base = score_view(evidence, p, &view);
            let signal = view.signal;
            let tile = evidence.pixels[p].tile;
            let train: Vec<bool> =
                (0..evidence.blocks.n()).map(|b| !evidence.is_held_out(tile, b)).collect();
            let mut g = DVector::zeros(k);
            let n = base.log_hazard.len();
            let mut rows = DMatrix::zeros(k, n);
            for (j, &at) in active.iter().enumerate() {
                let (moved, h) = stepped(evidence, model, (at, &coordinates[at]), p, &signal);
                for (i, (a, b)) in moved.log_hazard.iter().zip(&base.log_hazard).enumerate() {
                    if train[usize::from(base.block[i])] {
                        let d = (a - b) / h;
                        rows[(j, i)] = d;
                        g[j] += d;
                    }
                }
                for (b, train) in train.iter().enumerate() {
                    if *train {
                        g[j] -= (moved.compensator[b] - base.compensator[b]) / h;
                    }
                }
            }
            (g, &rows * rows.transpose())
        })
        .reduce(|| (DVector::zeros(k), DMatrix::zeros(k, k)), |a, b| (a.0 + b.0, a.1 + b.1));
    for (j, &at) in active.iter().enumerate() {
        let c = &coordinates[at];
        if c.sd.is_finite() {
            gradient[j] -= (model.values[at] - c.mean) / (c.sd * c.sd);
            information[(j, j)] += 1.0 / (c.sd * c.sd);
        }
    }
    LikelihoodSlope { gradient, information }
}

/// Thresholds scale the leaks, which are part of the signal.
fn needs_signal(model: &CameraModel, at: usize) -> bool {
    use super::constants::CameraConstant;
    let scaled = model.constant(CameraConstant::PhotoLeakHz) != 0.0
        || model.effects.iter().any(|e| e.stage == 2);
    scaled && (at == CameraConstant::LogTheta as usize || at == CameraConstant::LogRatio as usize)
}

/// Fits all coordinates of a model.
pub(crate) fn fit(evidence: &Evidence, start: CameraModel, max_steps: usize) -> ModelFit {
    let coordinates = start.coordinates(evidence);
    let mut model = start;
    for (v, c) in model.values.iter_mut().zip(&coordinates) {
        *v = v.clamp(c.range[0], c.range[1]);
    }
    let active: Vec<usize> = (0..model.values.len()).filter(|i| coordinates[*i].sd > 0.0).collect();
    let mut evaluation = ModelEvaluation::of(evidence, &model);
    let mut best = objective(evidence, &model, &evaluation, &coordinates);
    let mut damping = 1e-2;
    let mut covariance = None;
    for _ in 0..max_steps {
        let LikelihoodSlope { gradient, information } =
            slope(evidence, &model, &coordinates, &active);
        covariance = information.clone().try_inverse();
        let mut improved = 0.0;
        for _ in 0..7 {
            let mut damped = information.clone();
            for j in 0..active.len() {
                damped[(j, j)] += damping * information[(j, j)].max(1e-9);
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                damping *= 10.0;
                continue;
            };
            let mut trial = model.clone();
            for (j, &at) in active.iter().enumerate() {
                let c = &coordinates[at];
                trial.values[at] = (trial.values[at] + step[j]).clamp(c.range[0], c.range[1]);
            }
            let e = ModelEvaluation::of(evidence, &trial);
            let q = objective(evidence, &trial, &e, &coordinates);
            if q.is_finite() && q > best {
                improved = q - best;
                best = q;
                model = trial;
                evaluation = e;
                damping = (damping / 10.0_f64).max(1e-6);
                break;
            }
            damping *= 8.0;
        }
        if improved < 0.5 {
            break;
        }
    }
    ModelFit { model, evaluation, covariance, active }
}
