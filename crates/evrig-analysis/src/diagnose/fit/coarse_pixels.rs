//! Fits to a part of the pixels, from which those to all start.

use crate::diagnose::Evidence;
use crate::diagnose::fit::optimizer::{FitTolerance, ModelFit, fit, fit_coordinates};
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::model::constants::CameraConstant;

/// Largest number of optimizer steps with a part of the pixels, and with all.
pub(super) const N_STEPS: [usize; 2] = [10, 12];

/// Optimizer steps of a start.
const N_START_STEPS: usize = 4;

/// Events of a coarse fit; all pixels refine it.
const N_COARSE_EVENTS: usize = 4_000;

/// Threshold noise of a search, in thresholds: wide against the innovations that an effect causes,
/// so that the likelihood has one maximum. The fitted noise follows (graduated optimization).
pub(super) const WIDE_NOISE: f64 = 0.15;

/// A coarse number of pixels.
pub(super) struct CoarsePixels {
    /// Every `n`-th pixel is taken.
    pub(super) n: usize,
    pub(super) evidence: Evidence,
}

impl CoarsePixels {
    pub(super) fn of(evidence: &Evidence) -> Self {
        let n = (evidence.n_events() / N_COARSE_EVENTS).max(1);
        Self { n, evidence: evidence.thinned(n) }
    }

    /// Fits a model whose effects alone are known, with equal thresholds: a wide noise first, then
    /// the fitted one.
    pub(super) fn fit(&self, start: &CameraModel) -> ModelFit {
        self.fit_from(wide_start(&self.evidence, start))
    }

    /// The same from a stated start.
    pub(super) fn fit_from(&self, mut wide: CameraModel) -> ModelFit {
        let part = &self.evidence;
        wide.pin(CameraConstant::LogNoise, WIDE_NOISE.ln());
        let mut free = fit(part, wide, N_STEPS[0], FitTolerance::Coarse).model;
        free.limit(part, &[CameraConstant::LogNoise]);
        fit(part, free, N_STEPS[0], FitTolerance::Coarse)
    }

    /// A fit to all pixels of a model whose effects alone are known.
    pub(super) fn refit(&self, evidence: &Evidence, start: &CameraModel) -> ModelFit {
        refined(evidence, self.fit(start))
    }

    /// A model fitted with a wide noise.
    pub(super) fn widened(&self, now: &CameraModel) -> ModelFit {
        let mut model = now.thinned(self.n);
        let noise = model.constant(CameraConstant::LogNoise).max(WIDE_NOISE.ln());
        model.pin(CameraConstant::LogNoise, noise);
        fit(&self.evidence, model, N_STEPS[1], FitTolerance::Coarse)
    }
}

/// A model's effects and freed constants with the other constants at their prior means and equal
/// thresholds.
pub(super) fn at_prior_means(part: &Evidence, model: &CameraModel) -> CameraModel {
    model.with_constants_of(&CameraModel::baseline(part)).for_pixels(part)
}

/// A fit to all pixels from that to a part of them.
pub(super) fn refined(evidence: &Evidence, coarse: ModelFit) -> ModelFit {
    fit(evidence, coarse.model.for_pixels(evidence), N_STEPS[1], FitTolerance::Coarse)
}

/// Clock offsets from which a start is looked for, in bounds of the stated clock: between sparse
/// frames the likelihood has several maxima in time.
const START_OFFSETS: [f64; 3] = [-1.0, 0.0, 1.0];

/// A model at prior means, but for the threshold, the offset and a wide noise, which are fitted: the
/// best of several starts.
fn wide_start(part: &Evidence, model: &CameraModel) -> CameraModel {
    const FITTED: [CameraConstant; 3] =
        [CameraConstant::LogTheta, CameraConstant::LogNoise, CameraConstant::OffsetUs];
    let active = FITTED.map(|constant| constant as usize).to_vec();
    let mut plain = at_prior_means(part, model);
    plain.values[CameraConstant::LogNoise as usize] = WIDE_NOISE.ln();
    let offsets = if plain.is_limited(CameraConstant::OffsetUs) {
        START_OFFSETS.map(|offset| offset * part.facts.offset_bound_us).to_vec()
    } else {
        vec![plain.constant(CameraConstant::OffsetUs)]
    };
    let fits = offsets.into_iter().map(|offset| {
        let mut start = plain.clone();
        start.values[CameraConstant::OffsetUs as usize] = offset;
        fit_coordinates(part, start, active.clone(), N_START_STEPS, FitTolerance::Coarse)
    });
    let best = fits.max_by(|a, b| a.training(part).total_cmp(&b.training(part)));
    best.map_or(plain, |fit| fit.model)
}
