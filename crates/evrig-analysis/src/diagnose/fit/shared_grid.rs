//! Scores of several hypotheses at the same values of the pixels' own parameters.

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
    /// The same with every pixel of the kind that its training blocks speak for most, and with the shares of
    /// kinds as they are: what another effect would buy shows with one scoring of a pixel for all kinds.
    pub(crate) fn pin_strata(self, evidence: &Evidence) -> Self {
        let mixture = strata_of_pixels(evidence, &self);
        let pixels = evidence.pixels.iter().map(|pixel| (pixel.x, pixel.y));
        self.pin_strata_to(Some(Arc::new(pixels.zip(mixture).collect())))
    }
}

impl FittedModel {
    /// The same, from which hypotheses that are made of it are scored where it is.
    pub(crate) fn with_shared_grid(&self, evidence: &Evidence) -> Self {
        let mut held = self.clone();
        let mixture = self.hypothesis.pixel_mixture();
        if mixture.is_continuous() {
            let grids = Arc::new(ScoreGrids::of(evidence, &self.hypothesis, &mixture));
            held.hypothesis.shared_grid = Some(HeldGrid { grids, is_near: true });
        }
        held
    }

    /// What was found beside a held one, scored by itself.
    pub(crate) fn rescored(mut self, evidence: &Evidence) -> Self {
        match self.hypothesis.shared_grid.take() {
            Some(_) => score_model(evidence, self.hypothesis),
            None => self,
        }
    }
}
