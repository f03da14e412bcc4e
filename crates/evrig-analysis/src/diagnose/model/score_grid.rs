//! Shared grids of pixel values for hypotheses that are compared.
//!
//! Each pixel's own threshold is evaluated at values that depend on the hypothesis. The change of
//! grid between two hypotheses changes the score by more than a step of a fit, so that compared
//! hypotheses share one grid, without values that are negligible for the pixel.

use super::likelihood_profile::{LikelihoodProfile, likely, total};
use crate::diagnose::{Hypothesis, PixelEvidence, PixelStratum};
use crate::predict::BlockScore;
use std::collections::HashMap;
use std::sync::Arc;

/// Values this far below the maximum stay negligible for a nearby hypothesis.
const NEGLIGIBLE_NATS: f64 = 16.0;

/// Scored values to either side that the interpolating cubic uses.
const CUBIC_REACH: usize = 2;

/// Keeps a hypothesis to the grid of another.
#[derive(Debug, Clone)]
pub(crate) struct HeldGrid {
    pub(crate) grids: Arc<ScoreGrids>,
    /// Whether it is near enough for the other's negligible values to stay negligible.
    pub(crate) is_near: bool,
}

impl HeldGrid {
    /// The other hypothesis.
    pub(crate) fn other(&self) -> &Hypothesis {
        &self.grids.hypothesis
    }

    pub(crate) fn grid_of(&self, pixel: &PixelEvidence) -> Option<&PixelScoreGrid> {
        self.grids.of_pixel.get(&(pixel.x, pixel.y))
    }
}

/// Grids of all pixels.
#[derive(Debug)]
pub(crate) struct ScoreGrids {
    pub(crate) hypothesis: Hypothesis,
    pub(crate) of_pixel: HashMap<(u16, u16), PixelScoreGrid>,
}

/// Grid of a pixel.
#[derive(Debug)]
pub(crate) struct PixelScoreGrid {
    pub(crate) profile: LikelihoodProfile,
    /// Scores of negligible values, which are not evaluated again.
    pub(crate) far: Vec<Option<Vec<BlockScore>>>,
}

impl PixelScoreGrid {
    pub(crate) fn new(profile: LikelihoodProfile, scores: Vec<Vec<BlockScore>>) -> Self {
        let totals: Vec<[f64; 2]> = scores.iter().map(|blocks| total(blocks)).collect();
        let likely = likely(&totals, NEGLIGIBLE_NATS);
        let is_far = |i: usize| {
            let about = i.saturating_sub(CUBIC_REACH)..(i + CUBIC_REACH + 1).min(likely.len());
            likely[about].iter().all(|on_off| *on_off == [false; 2])
        };
        let far = scores.into_iter().enumerate().map(|(i, blocks)| is_far(i).then_some(blocks));
        Self { profile, far: far.collect() }
    }
}

/// Known strata by pixel.
pub(crate) type PinnedStrata = Arc<HashMap<(u16, u16), PixelStratum>>;

impl Hypothesis {
    /// Takes the known strata of another hypothesis, if there are any.
    pub(crate) fn pin_strata_as(self, other: &Self) -> Self {
        self.pin_strata_to(other.pinned_strata.clone())
    }

    pub(crate) fn pin_strata_to(mut self, strata: Option<PinnedStrata>) -> Self {
        let mixture = self.effects.iter().position(|effect| effect.mixture.is_some());
        if let (Some(index), Some(strata)) = (mixture, strata) {
            for at in self.value_indices(index) {
                self.steps[at] = 0.0;
            }
            self.pinned_strata = Some(strata);
        }
        self
    }

    /// Makes strata unknown again; `model` is what the hypothesis was made from.
    pub(crate) fn unpin_strata(mut self, model: &Self) -> Self {
        if self.pinned_strata.take().is_some() {
            self.steps[..model.steps.len()].copy_from_slice(&model.steps);
        }
        self
    }

    pub(crate) fn pinned_stratum(&self, pixel: &PixelEvidence) -> Option<PixelStratum> {
        self.pinned_strata.as_ref().and_then(|pinned| pinned.get(&(pixel.x, pixel.y)).copied())
    }

    /// Marks the hypothesis as far from its grid's.
    pub(crate) fn off_shared_grid(mut self) -> Self {
        if let Some(held) = &mut self.shared_grid {
            held.is_near = false;
        }
        self
    }
}
