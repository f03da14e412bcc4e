//! Where the own values of pixels are scored, kept from one hypothesis to the next.
//!
//! A pixel's own threshold is scored at as many values as its events need, and which these are changes from
//! one hypothesis to the next. What that does to a score is little, but more than a step of a fit or of a
//! difference quotient does: hypotheses that are compared with one another are scored at the same thresholds,
//! and but at those that a pixel may have.

use super::likelihood_profile::{LikelihoodProfile, likely, total};
use crate::diagnose::{Hypothesis, PixelEvidence, PixelStratum};
use crate::predict::BlockScore;
use std::collections::HashMap;
use std::sync::Arc;

/// Values this far below the maximum stay negligible for a nearby hypothesis.
const NEGLIGIBLE_NATS: f64 = 16.0;

/// Scored values to either side that the interpolating cubic uses.
const CUBIC_REACH: usize = 2;

/// What keeps a hypothesis to the kinds at which another is scored.
#[derive(Debug, Clone)]
pub(crate) struct HeldGrid {
    pub(crate) grids: Arc<ScoreGrids>,
    /// Whether it is so near to the other that what is far from likely for that is so for it.
    pub(crate) is_near: bool,
}

impl HeldGrid {
    /// The other.
    pub(crate) fn other(&self) -> &Hypothesis {
        &self.grids.hypothesis
    }

    pub(crate) fn grid_of(&self, pixel: &PixelEvidence) -> Option<&PixelScoreGrid> {
        self.grids.of_pixel.get(&(pixel.x, pixel.y))
    }
}

/// The kinds at which a hypothesis has its pixels scored.
#[derive(Debug)]
pub(crate) struct ScoreGrids {
    pub(crate) hypothesis: Hypothesis,
    pub(crate) of_pixel: HashMap<(u16, u16), PixelScoreGrid>,
}

/// The kinds at which a pixel is scored.
#[derive(Debug)]
pub(crate) struct PixelScoreGrid {
    pub(crate) profile: LikelihoodProfile,
    /// Of each value that was scored what it scores, if that is far from what the likeliest does: there it
    /// is not scored again.
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

/// Pixels by their place, each with the kind that it is taken to be.
pub(crate) type PinnedStrata = Arc<HashMap<(u16, u16), PixelStratum>>;

impl Hypothesis {
    /// The same with every pixel of the kind that it has in another hypothesis, if its kind is known there.
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

    /// The same with kinds that are not known again; `model` is what it was made from.
    pub(crate) fn unpin_strata(mut self, model: &Self) -> Self {
        if self.pinned_strata.take().is_some() {
            self.steps[..model.steps.len()].copy_from_slice(&model.steps);
        }
        self
    }

    /// The kind that a pixel is taken to be.
    pub(crate) fn pinned_stratum(&self, pixel: &PixelEvidence) -> Option<PixelStratum> {
        self.pinned_strata.as_ref().and_then(|pinned| pinned.get(&(pixel.x, pixel.y)).copied())
    }

    /// The same to make one of that lies further away from the one that it is held to.
    pub(crate) fn off_shared_grid(mut self) -> Self {
        if let Some(held) = &mut self.shared_grid {
            held.is_near = false;
        }
        self
    }
}
