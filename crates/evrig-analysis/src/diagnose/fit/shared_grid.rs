//! Scores of several hypotheses at the same values of the pixels' own parameters.

use super::fitted::Fitted;
use super::gauss_newton::as_it_is;
use super::pixel_strata::{Seen, kinds_of_pixels};
use crate::diagnose::model::score_grid::{Held, Places};
use crate::diagnose::{Evidence, Hypothesis, Mixture, PixelEvidence};
use rayon::prelude::*;
use std::sync::Arc;

impl Places {
    fn of(evidence: &Evidence, hypothesis: &Hypothesis, kinds: &Mixture) -> Self {
        let of_pixel = |pixel: &PixelEvidence| {
            let place = Seen::new(evidence, pixel, Vec::new()).place(hypothesis, kinds);
            ((pixel.x, pixel.y), place)
        };
        let of_pixel = evidence.pixels.par_iter().map(of_pixel).collect();
        Self { hypothesis: hypothesis.clone(), of_pixel }
    }
}

impl Hypothesis {
    /// The same with every pixel of the kind that its training blocks speak for most, and with the shares of
    /// kinds as they are: what another effect would buy shows with one scoring of a pixel for all kinds.
    pub(crate) fn pinned(self, evidence: &Evidence) -> Self {
        let kinds = kinds_of_pixels(evidence, &self);
        let pixels = evidence.pixels.iter().map(|pixel| (pixel.x, pixel.y));
        self.pinned_to(Some(Arc::new(pixels.zip(kinds).collect())))
    }
}

impl Fitted {
    /// The same, from which hypotheses that are made of it are scored where it is.
    pub(crate) fn held(&self, evidence: &Evidence) -> Self {
        let mut held = self.clone();
        let kinds = self.hypothesis.kinds();
        if kinds.is_even() {
            let places = Arc::new(Places::of(evidence, &self.hypothesis, &kinds));
            held.hypothesis.held = Some(Held { places, is_near: true });
        }
        held
    }

    /// What was found beside a held one, scored by itself.
    pub(crate) fn released(mut self, evidence: &Evidence) -> Self {
        match self.hypothesis.held.take() {
            Some(_) => as_it_is(evidence, self.hypothesis),
            None => self,
        }
    }
}
