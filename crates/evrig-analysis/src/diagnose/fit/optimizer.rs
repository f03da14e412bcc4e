//! Levenberg-Marquardt on the penalised log-likelihood.

use crate::diagnose::Evidence;
use crate::diagnose::levels::NEGLIGIBLE_NATS_PER_EVENT;
use crate::diagnose::model::camera_model::{CameraModel, FitCoordinate};
use crate::diagnose::model::terms::{PixelTerms, score_view, train_blocks};
use crate::diagnose::model::view::ModelledPixel;
use nalgebra::{DMatrix, DVector, RowDVector};
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
            for (block, log_hazard) in score.events() {
                let cell = &mut cells[pixel.tile * nb + block];
                cell[0] += log_hazard;
                cell[1] += 1.0;
            }
        }
        cells
    }

    /// Derivatives of the log hazards of training events by pixel, and of the training
    /// log-likelihood, from a base at a distance `step`.
    pub(crate) fn derivative(
        &self,
        evidence: &Evidence,
        base: &Self,
        step: f64,
    ) -> (Vec<Vec<f64>>, f64) {
        let pixels = self.pixels.iter().zip(&base.pixels).enumerate();
        let all = pixels
            .map(|(p, (moved, base))| moved.derivative(base, step, &train_blocks(evidence, p)));
        let (rows, slopes): (Vec<Vec<f64>>, Vec<f64>) = all.unzip();
        (rows, slopes.iter().sum())
    }

    /// Log-likelihood of the training cells.
    pub(crate) fn training(&self, evidence: &Evidence) -> f64 {
        let nb = evidence.blocks.n();
        let cells = self.cells(evidence).into_iter().enumerate();
        cells.filter(|(i, _)| !evidence.is_held_out(i / nb, i % nb)).map(|(_, c)| c[0]).sum()
    }
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
        self.evaluation.training(evidence)
    }
}

pub(crate) fn objective(
    evidence: &Evidence,
    model: &CameraModel,
    e: &ModelEvaluation,
    c: &[FitCoordinate],
) -> f64 {
    e.training(evidence) + model.log_prior(c)
}

/// Terms of a pixel with one coordinate stepped, inwards from a bound, and the step. `view` is the
/// pixel under the model.
pub(crate) fn stepped(
    evidence: &Evidence,
    model: &CameraModel,
    (at, coordinate): (usize, &FitCoordinate),
    p: usize,
    view: &ModelledPixel<'_>,
) -> (PixelTerms, f64) {
    let FitCoordinate { step, range, changes_signal, .. } = *coordinate;
    let mut other = model.clone();
    let h = if other.values[at] + step > range[1] { -step } else { step };
    other.values[at] += h;
    let keeps_signal = !changes_signal && !model.needs_signal(at);
    (other.score(evidence, p, keeps_signal.then_some(view)), h)
}

/// A pixel under a model, with the derivatives of its training terms by the active coordinates.
pub(crate) struct PixelSlope<'a> {
    pub(crate) view: ModelledPixel<'a>,
    pub(crate) terms: PixelTerms,
    /// Of the log hazards, by coordinate and event.
    pub(crate) rows: DMatrix<f64>,
    /// Of the log-likelihood.
    gradient: DVector<f64>,
}

/// The derivatives of every pixel, by forward differences.
pub(crate) fn pixel_slopes<'a>(
    evidence: &'a Evidence,
    model: &CameraModel,
    coordinates: &[FitCoordinate],
    active: &[usize],
) -> impl IndexedParallelIterator<Item = PixelSlope<'a>> {
    (0..evidence.pixels.len()).into_par_iter().map(move |p| {
        let view = model.view(evidence, p, None);
        let terms = score_view(evidence, p, &view);
        let train = train_blocks(evidence, p);
        let mut gradient = DVector::zeros(active.len());
        let mut rows = DMatrix::zeros(active.len(), terms.n_events());
        for (j, &at) in active.iter().enumerate() {
            let (moved, h) = stepped(evidence, model, (at, &coordinates[at]), p, &view);
            let (row, slope) = moved.derivative(&terms, h, &train);
            rows.set_row(j, &RowDVector::from_vec(row));
            gradient[j] = slope;
        }
        PixelSlope { view, terms, rows, gradient }
    })
}

/// Adds the information of the priors.
pub(crate) fn add_prior_information(
    information: &mut DMatrix<f64>,
    coordinates: &[FitCoordinate],
    active: &[usize],
) {
    for (j, &at) in active.iter().enumerate() {
        let c = &coordinates[at];
        if c.sd.is_finite() {
            information[(j, j)] += 1.0 / (c.sd * c.sd);
        }
    }
}

/// Gradient and event information of the training cells.
fn slope(
    evidence: &Evidence,
    model: &CameraModel,
    coordinates: &[FitCoordinate],
    active: &[usize],
) -> LikelihoodSlope {
    let k = active.len();
    let of_pixels: Vec<(DVector<f64>, DMatrix<f64>)> =
        pixel_slopes(evidence, model, coordinates, active)
            .map(|pixel| (pixel.gradient, &pixel.rows * pixel.rows.transpose()))
            .collect();
    // In the order of the pixels, so that no digit depends on the number of threads.
    let (mut gradient, mut information) = (DVector::zeros(k), DMatrix::zeros(k, k));
    for (g, own) in of_pixels {
        gradient += g;
        information += own;
    }
    for (j, &at) in active.iter().enumerate() {
        let c = &coordinates[at];
        if c.sd.is_finite() {
            gradient[j] -= (model.values[at] - c.mean) / (c.sd * c.sd);
        }
    }
    add_prior_information(&mut information, coordinates, active);
    LikelihoodSlope { gradient, information }
}

/// Inverse of the part of a matrix at some coordinates, zero elsewhere.
pub(crate) fn inverse_of(matrix: &DMatrix<f64>, at: &[usize]) -> Option<DMatrix<f64>> {
    // A ridge far below the resolution of finite differences: directions without information.
    let of = |i: usize, j: usize| matrix[(at[i], at[j])] * if i == j { 1.0 + 1e-9 } else { 1.0 };
    let part = DMatrix::from_fn(at.len(), at.len(), of).cholesky()?.inverse();
    let mut inverse = DMatrix::zeros(matrix.nrows(), matrix.ncols());
    for (i, a) in at.iter().enumerate() {
        for (j, b) in at.iter().enumerate() {
            inverse[(*a, *b)] = part[(i, j)];
        }
    }
    Some(inverse)
}

/// Improvement at which a fit ends.
#[derive(Debug, Clone, Copy)]
pub(crate) enum FitTolerance {
    /// A fifth of the smallest mismatch that is reported: of a fit that another one refines.
    Coarse,
    /// Half a nat: below the statistical error of a coordinate.
    Fine,
}

impl FitTolerance {
    fn nats(self, evidence: &Evidence) -> f64 {
        match self {
            Self::Coarse => (0.2 * NEGLIGIBLE_NATS_PER_EVENT * evidence.n_events() as f64).max(0.5),
            Self::Fine => 0.5,
        }
    }
}

/// Fits all coordinates of a model.
pub(crate) fn fit(
    evidence: &Evidence,
    start: CameraModel,
    max_steps: usize,
    tolerance: FitTolerance,
) -> ModelFit {
    let active = CameraModel::active(&start.coordinates(evidence));
    fit_coordinates(evidence, start, active, max_steps, tolerance)
}

/// Fits some coordinates of a model.
pub(crate) fn fit_coordinates(
    evidence: &Evidence,
    start: CameraModel,
    active: Vec<usize>,
    max_steps: usize,
    tolerance: FitTolerance,
) -> ModelFit {
    let coordinates = start.coordinates(evidence);
    let mut model = start;
    for (v, c) in model.values.iter_mut().zip(&coordinates) {
        *v = v.clamp(c.range[0], c.range[1]);
    }
    let mut evaluation = ModelEvaluation::of(evidence, &model);
    let mut best = objective(evidence, &model, &evaluation, &coordinates);
    let mut damping = 1e-2;
    let mut covariance = None;
    for _ in 0..max_steps {
        let LikelihoodSlope { gradient, information } =
            slope(evidence, &model, &coordinates, &active);
        // Coordinates that a bound holds, or on which no event depends, do not move, and the others
        // do not count on them.
        let is_held = |j: usize| {
            let [low, high] = coordinates[active[j]].range;
            let value = model.values[active[j]];
            let is_pushed = value <= low && gradient[j] < 0.0 || value >= high && gradient[j] > 0.0;
            is_pushed || information[(j, j)] <= 0.0
        };
        let free: Vec<usize> = (0..active.len()).filter(|j| !is_held(*j)).collect();
        covariance = inverse_of(&information, &free);
        let mut improved = 0.0;
        for _ in 0..7 {
            let mut damped = information.clone();
            for j in 0..active.len() {
                damped[(j, j)] += damping * information[(j, j)].max(1e-9);
            }
            let Some(step) = inverse_of(&damped, &free).map(|inverse| inverse * &gradient) else {
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
        if improved < tolerance.nats(evidence) {
            break;
        }
    }
    ModelFit { model, evaluation, covariance, active }
}
