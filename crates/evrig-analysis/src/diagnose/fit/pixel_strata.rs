//! Scores of pixels whose stratum is unknown.

use crate::diagnose::model::likelihood_profile::{LikelihoodProfile, score_profile};
use crate::diagnose::model::score_grid::PixelScoreGrid;
use crate::diagnose::{Evidence, Hypothesis, PixelEvidence, PixelMixture, PixelStratum};
use crate::predict::{BlockScore, PixelSignal, SignalKnots, score_pixel};
use rayon::prelude::*;
use std::borrow::Cow;

/// The most likely stratum of each pixel given its training blocks.
pub(crate) fn strata_of_pixels(evidence: &Evidence, hypothesis: &Hypothesis) -> Vec<PixelStratum> {
    let mixture = hypothesis.pixel_mixture();
    let of = |pixel: &PixelEvidence| {
        if let Some(known) = hypothesis.known_stratum(pixel, &mixture) {
            return known;
        }
        let mut scorer = PixelScorer::new(evidence, pixel, Vec::new());
        let mut by_value = scorer.profile_scores(hypothesis, &mixture);
        for block in (0..evidence.blocks.n()).filter(|b| !evidence.is_held_out(pixel.tile, *b)) {
            by_value.add(block);
        }
        mixture.most_likely(&by_value.logs())
    };
    evidence.pixels.par_iter().map(of).collect()
}

impl Hypothesis {
    /// The mixture of pixel strata; a single stratum without a mixture effect or with pinned
    /// strata.
    #[must_use]
    pub fn pixel_mixture(&self) -> PixelMixture {
        if self.pinned_strata.is_some() {
            return PixelMixture::single_stratum();
        }
        let mut effects = self.effects.iter().enumerate();
        match effects.find_map(|(index, effect)| Some((index, effect.mixture?))) {
            Some((index, mixture)) => mixture(self, index),
            None => PixelMixture::single_stratum(),
        }
    }

    /// A pixel's stratum, if known.
    fn known_stratum(&self, pixel: &PixelEvidence, mixture: &PixelMixture) -> Option<PixelStratum> {
        self.pinned_stratum(pixel).or_else(|| mixture.single())
    }
}

/// A pixel with the signal of the last hypothesis.
pub(crate) struct PixelScorer<'a> {
    evidence: &'a Evidence,
    pixel: &'a PixelEvidence,
    signal: Vec<f32>,
    bends: SignalKnots,
    of: Option<Hypothesis>,
}

impl<'a> PixelScorer<'a> {
    /// `signal` is reused memory.
    pub(crate) fn new(evidence: &'a Evidence, pixel: &'a PixelEvidence, signal: Vec<f32>) -> Self {
        Self { evidence, pixel, signal, bends: SignalKnots::default(), of: None }
    }

    /// Returns the memory.
    pub(crate) fn into_signal(self) -> Vec<f32> {
        self.signal
    }

    /// The pixel's scores by block.
    pub(crate) fn scores(
        &mut self,
        hypothesis: &Hypothesis,
        mixture: &PixelMixture,
    ) -> Vec<BlockScore> {
        if let Some(known) = hypothesis.known_stratum(self.pixel, mixture) {
            return self.score_stratum(hypothesis, known);
        }
        let by_value = self.profile_scores(hypothesis, mixture);
        let tile = self.pixel.tile;
        mix(mixture, by_value, |block| self.evidence.is_held_out(tile, block))
    }

    /// Scores by value, for both polarities.
    fn profile_scores<'k>(
        &mut self,
        hypothesis: &'k Hypothesis,
        mixture: &'k PixelMixture,
    ) -> ProfileScores<'k> {
        let held = hypothesis.shared_grid.as_ref();
        let held = held.and_then(|held| Some((held.is_near, held.grid_of(self.pixel)?)));
        let mut score = |i: usize| self.score_stratum(hypothesis, mixture.at(i));
        if let Some((is_near, place)) = held {
            let kept = |i: usize| is_near.then(|| place.far[i].clone()).flatten();
            let scored = place.profile.scored().iter().enumerate();
            let scores = scored.map(|(i, value)| kept(i).unwrap_or_else(|| score(*value)));
            return ProfileScores::new(Cow::Borrowed(&place.profile), scores.collect());
        }
        if mixture.is_continuous() && hypothesis.uses_fine_grid {
            let (profile, scores) = score_profile(mixture.n(), score);
            return ProfileScores::new(Cow::Owned(profile), scores);
        }
        let profile = mixture.coarse_profile();
        ProfileScores::new(
            Cow::Borrowed(profile),
            profile.scored().iter().copied().map(score).collect(),
        )
    }

    /// The grid at which a hypothesis evaluates the pixel.
    pub(crate) fn score_grid(
        &mut self,
        hypothesis: &Hypothesis,
        mixture: &PixelMixture,
    ) -> PixelScoreGrid {
        let ProfileScores { profile, scores, .. } = self.profile_scores(hypothesis, mixture);
        PixelScoreGrid::new(profile.into_owned(), scores)
    }

    fn score_stratum(&mut self, hypothesis: &Hypothesis, stratum: PixelStratum) -> Vec<BlockScore> {
        if hypothesis.leaves_light_unchanged(self.pixel) {
            let view = hypothesis.view_with(self.evidence, self.pixel, stratum, Vec::new());
            let (signal, bends) = (&self.pixel.light, Some(self.pixel.bends()));
            let light = PixelSignal { signal, knots: bends, ..view.light() };
            return score_pixel(&view.law, light, &self.pixel.spikes, &self.evidence.blocks);
        }
        let signal = std::mem::take(&mut self.signal);
        let view = if self.of.as_ref().is_some_and(|of| of.has_same_signal(hypothesis)) {
            hypothesis.view_with(self.evidence, self.pixel, stratum, signal)
        } else {
            self.of = Some(hypothesis.clone());
            let view = hypothesis.view(self.evidence, self.pixel, stratum, signal);
            let PixelSignal { signal, level, .. } = view.light();
            self.bends.set(signal, level);
            view
        };
        let light = PixelSignal { knots: Some(&self.bends), ..view.light() };
        let scores = score_pixel(&view.law, light, &self.pixel.spikes, &self.evidence.blocks);
        self.signal = view.signal;
        scores
    }
}

/// Scores by value, summed over some blocks.
struct ProfileScores<'a> {
    profile: Cow<'a, LikelihoodProfile>,
    /// Per evaluated value, by block.
    scores: Vec<Vec<BlockScore>>,
    /// Sums over blocks per evaluated value, ON and OFF.
    sums: [Vec<f64>; 2],
}

impl<'a> ProfileScores<'a> {
    fn new(profile: Cow<'a, LikelihoodProfile>, scores: Vec<Vec<BlockScore>>) -> Self {
        let sums = [vec![0.0; scores.len()], vec![0.0; scores.len()]];
        Self { profile, scores, sums }
    }

    fn add(&mut self, block: usize) {
        for (polarity, sums) in self.sums.iter_mut().enumerate() {
            for (sum, scores) in sums.iter_mut().zip(&self.scores) {
                *sum += scores[block].on_off[polarity];
            }
        }
    }

    /// Summed log-likelihoods of all values, ON and OFF.
    fn logs(&self) -> [Vec<f64>; 2] {
        self.sums.each_ref().map(|sums| self.profile.interpolate(sums))
    }
}

/// Sequential marginal likelihoods over strata: training blocks first, then held-out blocks
/// predicted from the posterior. Stored as ON scores.
fn mix(
    mixture: &PixelMixture,
    mut by_value: ProfileScores<'_>,
    is_held_out: impl Fn(usize) -> bool,
) -> Vec<BlockScore> {
    let n_blocks = by_value.scores.first().map_or(0, Vec::len);
    let mut before = mixture.ln_likelihood(&by_value.logs());
    let mut mixed = vec![BlockScore::default(); n_blocks];
    for held_out in [false, true] {
        for block in (0..n_blocks).filter(|&block| is_held_out(block) == held_out) {
            by_value.add(block);
            let now = mixture.ln_likelihood(&by_value.logs());
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
    fn training_blocks_predict_held_out_blocks() {
        let score = |on: f64, off: f64| BlockScore { on_off: [on, off], n_events: 1 };
        // ON events prefer the third value, OFF events the first.
        let by_value =
            vec![vec![score(0.0, 4.0); 2], vec![score(1.0, 1.0); 2], vec![score(4.0, 0.0); 2]];
        for (is_one, best) in [(true, 3.891), (false, 7.787)] {
            let by_value = ProfileScores::new(
                Cow::Owned(LikelihoodProfile::every_nth(3, 1)),
                by_value.clone(),
            );
            let mixed = mix(&PixelMixture::of_three(is_one), by_value, |block| block == 1);
            assert!(mixed[0].log_likelihood() < mixed[1].log_likelihood(), "{mixed:?}");
            assert!((mixed[1].log_likelihood() - best).abs() < 0.01, "{is_one}: {mixed:?}");
        }
    }
}
