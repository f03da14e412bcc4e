//! What pixels of several kinds score, of which it is not known which is which.

use super::curve::{Curve, scored};
use super::places::Place;
use super::{Evidence, Hypothesis, Kind, Mixture, PixelEvidence};
use crate::predict::{BlockScore, PixelSignal, SignalKnots, score_pixel};
use rayon::prelude::*;
use std::borrow::Cow;

/// The kind of each pixel that its training blocks speak for most.
pub(super) fn kinds_of_pixels(evidence: &Evidence, hypothesis: &Hypothesis) -> Vec<Kind> {
    let kinds = hypothesis.kinds();
    let of = |pixel: &PixelEvidence| {
        if let Some(known) = hypothesis.known_kind(pixel, &kinds) {
            return known;
        }
        let mut seen = Seen::new(evidence, pixel, Vec::new());
        let mut by_value = seen.by_value(hypothesis, &kinds);
        for block in (0..evidence.blocks.n()).filter(|b| !evidence.is_held_out(pixel.tile, *b)) {
            by_value.add(block);
        }
        kinds.best(&by_value.logs())
    };
    evidence.pixels.par_iter().map(of).collect()
}

impl Hypothesis {
    /// The kinds of pixel that a mixture effect tells apart; one kind without such, and where each pixel is taken
    /// to be of a known one.
    #[must_use]
    pub fn kinds(&self) -> Mixture {
        if self.pinned.is_some() {
            return Mixture::alike();
        }
        let mut effects = self.effects.iter().enumerate();
        match effects.find_map(|(index, effect)| Some((index, effect.mixture?))) {
            Some((index, mixture)) => mixture(self, index),
            None => Mixture::alike(),
        }
    }

    /// The kind of a pixel, where that is no question.
    fn known_kind(&self, pixel: &PixelEvidence, kinds: &Mixture) -> Option<Kind> {
        self.pinned_kind(pixel).or_else(|| kinds.only())
    }
}

/// A pixel with the signal that the last hypothesis made of it.
pub(super) struct Seen<'a> {
    evidence: &'a Evidence,
    pixel: &'a PixelEvidence,
    signal: Vec<f32>,
    bends: SignalKnots,
    of: Option<Hypothesis>,
}

impl<'a> Seen<'a> {
    /// `signal` is memory to use.
    pub(super) fn new(evidence: &'a Evidence, pixel: &'a PixelEvidence, signal: Vec<f32>) -> Self {
        Self { evidence, pixel, signal, bends: SignalKnots::default(), of: None }
    }

    /// The memory again.
    pub(super) fn into_signal(self) -> Vec<f32> {
        self.signal
    }

    /// The pixel's scores, whatever its kind.
    pub(super) fn scores(&mut self, hypothesis: &Hypothesis, kinds: &Mixture) -> Vec<BlockScore> {
        if let Some(known) = hypothesis.known_kind(self.pixel, kinds) {
            return self.of_kind(hypothesis, known);
        }
        let by_value = self.by_value(hypothesis, kinds);
        let tile = self.pixel.tile;
        mix(kinds, by_value, |block| self.evidence.is_held_out(tile, block))
    }

    /// The scores by the value that is given for both polarities.
    fn by_value<'k>(&mut self, hypothesis: &'k Hypothesis, kinds: &'k Mixture) -> ByValue<'k> {
        let held = hypothesis.held.as_ref();
        let held = held.and_then(|held| Some((held.is_near, held.place(self.pixel)?)));
        let mut score = |i: usize| self.of_kind(hypothesis, kinds.at(i));
        if let Some((is_near, place)) = held {
            let kept = |i: usize| is_near.then(|| place.far[i].clone()).flatten();
            let scored = place.curve.scored().iter().enumerate();
            let scores = scored.map(|(i, value)| kept(i).unwrap_or_else(|| score(*value)));
            return ByValue::new(Cow::Borrowed(&place.curve), scores.collect());
        }
        if kinds.is_even() && hypothesis.is_fine {
            let (curve, scores) = scored(kinds.n(), score);
            return ByValue::new(Cow::Owned(curve), scores);
        }
        let curve = kinds.coarse();
        ByValue::new(Cow::Borrowed(curve), curve.scored().iter().copied().map(score).collect())
    }

    /// Where a hypothesis scores the pixel.
    pub(super) fn place(&mut self, hypothesis: &Hypothesis, kinds: &Mixture) -> Place {
        let ByValue { curve, scores, .. } = self.by_value(hypothesis, kinds);
        Place::new(curve.into_owned(), scores)
    }

    fn of_kind(&mut self, hypothesis: &Hypothesis, kind: Kind) -> Vec<BlockScore> {
        if hypothesis.leaves_light(self.pixel) {
            let view = hypothesis.view_with(self.evidence, self.pixel, kind, Vec::new());
            let (signal, bends) = (&self.pixel.light, Some(self.pixel.bends()));
            let light = PixelSignal { signal, knots: bends, ..view.light() };
            return score_pixel(&view.law, light, &self.pixel.spikes, &self.evidence.blocks);
        }
        let signal = std::mem::take(&mut self.signal);
        let view = if self.of.as_ref().is_some_and(|of| of.has_signal_of(hypothesis)) {
            hypothesis.view_with(self.evidence, self.pixel, kind, signal)
        } else {
            self.of = Some(hypothesis.clone());
            let view = hypothesis.view(self.evidence, self.pixel, kind, signal);
            self.bends.set(view.light());
            view
        };
        let light = PixelSignal { knots: Some(&self.bends), ..view.light() };
        let scores = score_pixel(&view.law, light, &self.pixel.spikes, &self.evidence.blocks);
        self.signal = view.signal;
        scores
    }
}

/// What a pixel scores by its value, added up over some blocks.
struct ByValue<'a> {
    curve: Cow<'a, Curve>,
    /// Of each value that was scored, by block.
    scores: Vec<Vec<BlockScore>>,
    /// Sums over blocks, On and Off, of each value that was scored.
    sums: [Vec<f64>; 2],
}

impl<'a> ByValue<'a> {
    fn new(curve: Cow<'a, Curve>, scores: Vec<Vec<BlockScore>>) -> Self {
        let sums = [vec![0.0; scores.len()], vec![0.0; scores.len()]];
        Self { curve, scores, sums }
    }

    fn add(&mut self, block: usize) {
        for (polarity, sums) in self.sums.iter_mut().enumerate() {
            for (sum, scores) in sums.iter_mut().zip(&self.scores) {
                *sum += scores[block].on_off[polarity];
            }
        }
    }

    /// Of every value what was added up, On and Off.
    fn logs(&self) -> [Vec<f64>; 2] {
        self.sums.each_ref().map(|sums| self.curve.at_all(sums))
    }
}

/// The scores of a pixel of unknown kind: its training blocks weigh the kinds, one after another,
/// and the held-out blocks are then predicted with those weights. They stand as scores of On.
fn mix(
    kinds: &Mixture,
    mut by_value: ByValue<'_>,
    is_held_out: impl Fn(usize) -> bool,
) -> Vec<BlockScore> {
    let n_blocks = by_value.scores.first().map_or(0, Vec::len);
    let mut before = kinds.ln_likelihood(&by_value.logs());
    let mut mixed = vec![BlockScore::default(); n_blocks];
    for held_out in [false, true] {
        for block in (0..n_blocks).filter(|&block| is_held_out(block) == held_out) {
            by_value.add(block);
            let now = kinds.ln_likelihood(&by_value.logs());
            let n_events = by_value.scores[0][block].n_events;
            mixed[block] = BlockScore { on_off: [now - before, 0.0], n_events };
            before = now;
        }
    }
    mixed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_training_says_of_a_pixel_predicts_the_rest() {
        let score = |on: f64, off: f64| BlockScore { on_off: [on, off], n_events: 1 };
        // On events speak for the third value, Off events for the first.
        let by_value =
            vec![vec![score(0.0, 4.0); 2], vec![score(1.0, 1.0); 2], vec![score(4.0, 0.0); 2]];
        for (is_one, best) in [(true, 3.891), (false, 7.787)] {
            let by_value = ByValue::new(Cow::Owned(Curve::of(3, 1)), by_value.clone());
            let mixed = mix(&Mixture::of_three(is_one), by_value, |block| block == 1);
            assert!(mixed[0].log_likelihood() < mixed[1].log_likelihood(), "{mixed:?}");
            assert!((mixed[1].log_likelihood() - best).abs() < 0.01, "{is_one}: {mixed:?}");
        }
    }
}
