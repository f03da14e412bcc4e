//! Efficient score test of an effect: one evaluation per trial.

use crate::diagnose::Evidence;
use crate::diagnose::fit::optimizer::{
    ModelEvaluation, add_prior_information, inverse_of, pixel_slopes,
};
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::model::terms::train_blocks;
use crate::diagnose::model::view::ModelledPixel;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Gain of a trial in nats.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub(crate) enum ScanGain {
    /// Of a step towards it, to first order; the trial itself is a loss.
    Predicted(f64),
    /// Of the trial as it is, which is better than any prediction.
    Reached(f64),
}

impl ScanGain {
    pub(crate) fn nats(self) -> f64 {
        match self {
            Self::Predicted(nats) | Self::Reached(nats) => nats,
        }
    }
}

/// How much a first-order step along an effect would gain on the training cells, given that the
/// constants follow (efficient score).
pub(crate) struct ScoreScan<'a> {
    evidence: &'a Evidence,
    model: CameraModel,
    views: Vec<ModelledPixel<'a>>,
    /// Derivatives of the log hazards of training events, by active coordinate.
    rows: Vec<DMatrix<f64>>,
    information: DMatrix<f64>,
    active: Vec<usize>,
    base: ModelEvaluation,
}

impl<'a> ScoreScan<'a> {
    pub(crate) fn new(evidence: &'a Evidence, model: &CameraModel) -> Self {
        let coordinates = model.coordinates(evidence);
        let active = CameraModel::active(&coordinates);
        let all: Vec<_> = pixel_slopes(evidence, model, &coordinates, &active).collect();
        let k = active.len();
        let mut information = DMatrix::zeros(k, k);
        for pixel in &all {
            information += &pixel.rows * pixel.rows.transpose();
        }
        add_prior_information(&mut information, &coordinates, &active);
        let (rows, terms): (_, Vec<_>) =
            all.into_iter().map(|pixel| (pixel.rows, (pixel.terms, pixel.view))).unzip();
        let (pixels, views) = terms.into_iter().unzip();
        let base = ModelEvaluation { pixels };
        Self { evidence, model: model.clone(), views, rows, information, active, base }
    }

    /// Terms under a trial; the signal is not computed again where the trial leaves it.
    pub(crate) fn evaluate(&self, trial: &CameraModel) -> ModelEvaluation {
        let coordinates = trial.coordinates(self.evidence);
        let keeps = trial.has_signal_of(&self.model, &coordinates);
        let one = |p| trial.score(self.evidence, p, keeps.then(|| &self.views[p]));
        let pixels = (0..self.views.len()).into_par_iter().map(one).collect();
        ModelEvaluation { pixels }
    }

    /// Coordinates that are fitted.
    pub(crate) fn active(&self) -> &[usize] {
        &self.active
    }

    /// Inverse information of those but some, which do not follow.
    pub(crate) fn inverse_without(&self, own: &[usize]) -> DMatrix<f64> {
        let k = self.active.len();
        let kept: Vec<usize> = (0..k).filter(|j| !own.contains(&self.active[*j])).collect();
        inverse_of(&self.information, &kept).unwrap_or_else(|| DMatrix::zeros(k, k))
    }

    /// Information that the fitted coordinates and a step away from `base` share, per unit of the
    /// step.
    pub(crate) fn cross_information(
        &self,
        moved: &ModelEvaluation,
        base: &ModelEvaluation,
        step: f64,
    ) -> DVector<f64> {
        let (derivative, _) = moved.derivative(self.evidence, base, step);
        let mut cross = DVector::zeros(self.active.len());
        for (rows, derivative) in self.rows.iter().zip(derivative) {
            cross += rows * DVector::from_vec(derivative);
        }
        cross
    }

    /// Gain in nats on the training cells of a trial, which differs in `own`.
    pub(crate) fn gain(&self, trial: &CameraModel, own: &[usize]) -> ScanGain {
        let evidence = self.evidence;
        let there = self.evaluate(trial);
        let inverse = self.inverse_without(own);
        let (mut u, mut square, mut actual) = (0.0, 0.0, 0.0);
        let mut cross = DVector::zeros(self.active.len());
        for (p, (a, b)) in there.pixels.iter().zip(&self.base.pixels).enumerate() {
            let train = train_blocks(evidence, p);
            for (i, _, change) in a.changes(b).filter(|(_, block, _)| train[*block]) {
                actual += change;
                let d = change.clamp(-2.0, 2.0);
                u += d;
                square += d * d;
                cross += self.rows[p].column(i) * d;
            }
            for change in a.compensator_changes(b, &train) {
                u -= change;
                actual -= change;
            }
        }
        // To second order the compensator contains half the information.
        u += 0.5 * square;
        let left =
            (square - (cross.transpose() * inverse * &cross)[(0, 0)]).max(1e-3 * square).max(1e-9);
        let step = (u / left).clamp(0.0, 1.0);
        if actual > 0.0 {
            ScanGain::Reached(actual)
        } else {
            ScanGain::Predicted(step * u - 0.5 * step * step * left)
        }
    }
}
