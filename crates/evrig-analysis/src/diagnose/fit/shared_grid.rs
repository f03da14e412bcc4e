//! Pinned strata and shared grids for comparable scores of several hypotheses.

use super::fitted::FittedModel;
use super::gauss_newton::score_model;
use super::pixel_strata::{PixelScorer, strata_of_pixels};
use crate::diagnose::model::score_grid::{HeldGrid, ScoreGrids};
use crate::diagnose::{Evidence, Hypothesis, PixelEvidence, PixelMixture};
use rayon::prelude::*;
use std::sync::Arc;

impl ScoreGrids {
    fn of(evidence: &Evidence, hypothesis: &Hypothesis, mixture: &PixelMixture) -> Self {
        let of_pixel = |pixel: &PixelEvidence| {
            let grid =
                PixelScorer::new(evidence, pixel, Vec::new()).score_grid(hypothesis, mixture);
            ((pixel.x, pixel.y), grid)
        };
        let of_pixel = evidence.pixels.par_iter().map(of_pixel).collect();
        Self { hypothesis: hypothesis.clone(), of_pixel }
    }
}

impl Hypothesis {
    /// Pins every pixel to its most likely stratum, with the weights of the strata unchanged: a
    /// new effect's gain then takes one evaluation per pixel.
    pub(crate) fn pin_strata(self, evidence: &Evidence) -> Self {
        let mixture = strata_of_pixels(evidence, &self);
        let pixels = evidence.pixels.iter().map(|pixel| (pixel.x, pixel.y));
        self.pin_strata_to(Some(Arc::new(pixels.zip(mixture).collect())))
    }
}

impl FittedModel {
    /// The same fit; hypotheses made from it share its grid.
    pub(crate) fn with_shared_grid(&self, evidence: &Evidence) -> Self {
        let mut held = self.clone();
        let mixture = self.hypothesis.pixel_mixture();
        if mixture.is_continuous() {
            let grids = Arc::new(ScoreGrids::of(evidence, &self.hypothesis, &mixture));
            held.hypothesis.shared_grid = Some(HeldGrid { grids, is_near: true });
        }
        held
    }

    /// The score without a shared grid.
    pub(crate) fn rescored(mut self, evidence: &Evidence) -> Self {
        match self.hypothesis.shared_grid.take() {
            Some(_) => score_model(evidence, self.hypothesis),
            None => self,
        }
    }
}
