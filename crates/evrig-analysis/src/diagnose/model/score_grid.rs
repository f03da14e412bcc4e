//! Where the own values of pixels are scored, kept from one hypothesis to the next.
//!
//! A pixel's own threshold is scored at as many values as its events need, and which these are changes from
//! one hypothesis to the next. What that does to a score is little, but more than a step of a fit or of a
//! difference quotient does: hypotheses that are compared with one another are scored at the same thresholds,
//! and but at those that a pixel may have.

use super::likelihood_profile::{Curve, likely, total};
use crate::diagnose::{Hypothesis, Kind, PixelEvidence};
use crate::predict::BlockScore;
use std::collections::HashMap;
use std::sync::Arc;

/// A likelihood so many nats below the greatest is none that another hypothesis near by could bring back.
const FAR: f64 = 16.0;

/// Scored values on either side of one that is not far, which have a part in the cubic about it.
const BESIDE: usize = 2;

/// What keeps a hypothesis to the kinds at which another is scored.
#[derive(Debug, Clone)]
pub(crate) struct Held {
    pub(crate) places: Arc<Places>,
    /// Whether it is so near to the other that what is far from likely for that is so for it.
    pub(crate) is_near: bool,
}

impl Held {
    /// The other.
    pub(crate) fn other(&self) -> &Hypothesis {
        &self.places.hypothesis
    }

    pub(crate) fn place(&self, pixel: &PixelEvidence) -> Option<&Place> {
        self.places.of_pixel.get(&(pixel.x, pixel.y))
    }
}

/// The kinds at which a hypothesis has its pixels scored.
#[derive(Debug)]
pub(crate) struct Places {
    pub(crate) hypothesis: Hypothesis,
    pub(crate) of_pixel: HashMap<(u16, u16), Place>,
}

/// The kinds at which a pixel is scored.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) curve: Curve,
    /// Of each value that was scored what it scores, if that is far from what the likeliest does: there it
    /// is not scored again.
    pub(crate) far: Vec<Option<Vec<BlockScore>>>,
}

impl Place {
    pub(crate) fn new(curve: Curve, scores: Vec<Vec<BlockScore>>) -> Self {
        let totals: Vec<[f64; 2]> = scores.iter().map(|blocks| total(blocks)).collect();
        let likely = likely(&totals, FAR);
        let is_far = |i: usize| {
            let about = i.saturating_sub(BESIDE)..(i + BESIDE + 1).min(likely.len());
            likely[about].iter().all(|on_off| *on_off == [false; 2])
        };
        let far = scores.into_iter().enumerate().map(|(i, blocks)| is_far(i).then_some(blocks));
        Self { curve, far: far.collect() }
    }
}

/// Pixels by their place, each with the kind that it is taken to be.
pub(crate) type Pinned = Arc<HashMap<(u16, u16), Kind>>;

impl Hypothesis {
    /// The same with every pixel of the kind that it has in another hypothesis, if its kind is known there.
    pub(crate) fn pinned_as(self, other: &Self) -> Self {
        self.pinned_to(other.pinned.clone())
    }

    pub(crate) fn pinned_to(mut self, kinds: Option<Pinned>) -> Self {
        let mixture = self.effects.iter().position(|effect| effect.mixture.is_some());
        if let (Some(index), Some(kinds)) = (mixture, kinds) {
            for at in self.places_of(index) {
                self.steps[at] = 0.0;
            }
            self.pinned = Some(kinds);
        }
        self
    }

    /// The same with kinds that are not known again; `model` is what it was made from.
    pub(crate) fn unpinned(mut self, model: &Self) -> Self {
        if self.pinned.take().is_some() {
            self.steps[..model.steps.len()].copy_from_slice(&model.steps);
        }
        self
    }

    /// The kind that a pixel is taken to be.
    pub(crate) fn pinned_kind(&self, pixel: &PixelEvidence) -> Option<Kind> {
        self.pinned.as_ref().and_then(|pinned| pinned.get(&(pixel.x, pixel.y)).copied())
    }

    /// The same to make one of that lies further away from the one that it is held to.
    pub(crate) fn leaving(mut self) -> Self {
        if let Some(held) = &mut self.held {
            held.is_near = false;
        }
        self
    }
}
