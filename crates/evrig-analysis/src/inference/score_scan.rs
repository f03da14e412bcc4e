//! Efficient score test of an effect: one evaluation per trial.

use super::fit::{ModelEvaluation, stepped};
use super::model::{CameraModel, PixelTerms, score_view};
use crate::diagnose::Evidence;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// How much a first-order step along an effect would gain on the training cells, given that the
/// constants follow (efficient score).
pub(crate) struct ScoreScan {
    /// Derivatives of the log hazards of training events, by active coordinate.
    rows: Vec<DMatrix<f64>>,
    inverse: DMatrix<f64>,
    base: ModelEvaluation,
}

impl ScoreScan {
    pub(crate) fn new(evidence: &Evidence, model: &CameraModel) -> Self {
        let coordinates = model.coordinates(evidence);
        let active: Vec<usize> =
            (0..model.values.len()).filter(|i| coordinates[*i].sd > 0.0).collect();
        let all: Vec<(DMatrix<f64>, PixelTerms)> = (0..evidence.pixels.len())
            .into_par_iter()
            .map(|p| {
                let view = model.view(evidence, p, None);
                let base = score_view(evidence, p, &view);
                let signal = view.signal;
                let mut rows = DMatrix::zeros(active.len(), base.log_hazard.len());
                for (j, &at) in active.iter().enumerate() {
                    let (moved, h) = stepped(evidence, model, (at, &coordinates[at]), p, &signal);
                    for (i, (a, b)) in moved.log_hazard.iter().zip(&base.log_hazard).enumerate() {
                        if is_train(evidence, p, usize::from(base.block[i])) {
                            rows[(j, i)] = (a - b) / h;
                        }
                    }
                }
                (rows, base)
            })
            .collect();
        let k = active.len();
        let mut information = DMatrix::zeros(k, k);
        for (rows, _) in &all {
            information += rows * rows.transpose();
        }
        for (j, &at) in active.iter().enumerate() {
            let c = &coordinates[at];
            if c.sd.is_finite() {
                information[(j, j)] += 1.0 / (c.sd * c.sd);
            }
        }
        let inverse =
            information.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(k, k) * 0.0);
        let (rows, pixels) = all.into_iter().unzip();
        Self { rows, inverse, base: ModelEvaluation { pixels } }
    }

    /// Gain in nats on the training cells: of the trial as it is, or predicted for a step towards it
    /// no longer than the trial, whichever is more.
    pub(crate) fn gain(&self, evidence: &Evidence, trial: &CameraModel) -> f64 {
        let there = ModelEvaluation::of(evidence, trial);
        let k = self.inverse.nrows();
        let (mut u, mut own, mut actual) = (0.0, 0.0, 0.0);
        let mut cross = DVector::zeros(k);
        for (p, (a, b)) in there.pixels.iter().zip(&self.base.pixels).enumerate() {
            for (i, (x, y)) in a.log_hazard.iter().zip(&b.log_hazard).enumerate() {
                if is_train(evidence, p, usize::from(b.block[i])) {
                    actual += x - y;
                    let d = (x - y).clamp(-2.0, 2.0);
                    u += d;
                    own += d * d;
                    cross += self.rows[p].column(i) * d;
                }
            }
            for (block, (x, y)) in a.compensator.iter().zip(&b.compensator).enumerate() {
                if is_train(evidence, p, block) {
                    u -= x - y;
                    actual -= x - y;
                }
            }
        }
        // To second order the compensator contains half the information.
        u += 0.5 * own;
        let left =
            (own - (cross.transpose() * &self.inverse * &cross)[(0, 0)]).max(1e-3 * own).max(1e-9);
        let step = (u / left).clamp(0.0, 1.0);
        actual.max(step * u - 0.5 * step * step * left)
    }
}

fn is_train(evidence: &Evidence, p: usize, block: usize) -> bool {
    !evidence.is_held_out(evidence.pixels[p].tile, block)
}
