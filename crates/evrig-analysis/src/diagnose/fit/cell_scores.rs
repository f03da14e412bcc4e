//! Log-likelihoods by cell: a tile of pixels during a time block.

use super::pixel_strata::PixelScorer;
use crate::diagnose::{Evidence, Hypothesis, PixelEvidence, PixelMixture};
use crate::predict::BlockScore;
use rayon::prelude::*;

/// Least gain of a named effect: the shape of the noise model matters as much below.
pub(crate) const MIN_GAIN_NATS_PER_EVENT: f64 = 0.02;

/// Significance level for a gain.
pub(crate) const MIN_GAIN_STANDARD_ERRORS: f64 = 4.0;

/// A gain that is above these and not significant is reported as a rejected effect.
const SUGGESTIVE_GAIN_NATS_PER_EVENT: f64 = 0.06;
const SUGGESTIVE_GAIN_STANDARD_ERRORS: f64 = 3.0;

/// Whether a held-out gain is significant.
pub(crate) fn is_significant(gain: f64, error: f64) -> bool {
    gain >= MIN_GAIN_NATS_PER_EVENT && gain >= MIN_GAIN_STANDARD_ERRORS * error
}

/// Whether it is large though not significant.
pub(crate) fn is_suggestive(gain: f64, error: f64) -> bool {
    gain > SUGGESTIVE_GAIN_NATS_PER_EVENT && gain > SUGGESTIVE_GAIN_STANDARD_ERRORS * error
}

/// Log-likelihood and number of events per cell.
#[derive(Debug, Clone)]
pub(crate) struct CellScores {
    pub(crate) log_likelihood: Vec<f64>,
    pub(crate) n_events: Vec<f64>,
    held_out: Vec<bool>,
}

/// Cross-validation set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CellSet {
    Training,
    HeldOut,
}

impl CellScores {
    pub(crate) fn of(&self, part: CellSet) -> impl Iterator<Item = usize> + '_ {
        let wanted = part == CellSet::HeldOut;
        (0..self.held_out.len()).filter(move |&cell| self.held_out[cell] == wanted)
    }

    /// Log-likelihood per event, nats.
    pub(crate) fn nats(&self, part: CellSet) -> f64 {
        self.total(part) / self.events(part).max(1.0)
    }

    /// Log-likelihood, nats.
    pub(crate) fn total(&self, part: CellSet) -> f64 {
        self.of(part).fold(0.0, |sum, cell| sum + self.log_likelihood[cell])
    }

    pub(crate) fn events(&self, part: CellSet) -> f64 {
        self.of(part).fold(0.0, |sum, cell| sum + self.n_events[cell])
    }

    /// Gain over `other`, nats per event, with its standard error from the scatter over cells.
    pub(crate) fn gain(&self, other: &Self, part: CellSet) -> (f64, f64) {
        self.stratified_gain(other, part, |_| true)
    }

    /// The same where two strata of cells differ in their expected gain.
    pub(crate) fn stratified_gain(
        &self,
        other: &Self,
        part: CellSet,
        is_first: impl Fn(usize) -> bool,
    ) -> (f64, f64) {
        let used = self.of(part).filter(|&c| self.is_used(c) || other.is_used(c));
        let (first, rest): (Vec<usize>, Vec<usize>) = used.partition(|&cell| is_first(cell));
        let mut sums = [0.0; 3];
        for stratum in [first, rest] {
            let sum = |of: &dyn Fn(usize) -> f64| stratum.iter().map(|&c| of(c)).sum::<f64>();
            let difference = |c: usize| self.log_likelihood[c] - other.log_likelihood[c];
            let (gain, n) = (sum(&difference), sum(&|c| self.n_events[c]));
            let mean = gain / n.max(1.0);
            // Ratio estimate over clusters (Cochran, Sampling Techniques, 1977, section 6.4).
            let square = sum(&|c| (difference(c) - mean * self.n_events[c]).powi(2));
            let g = stratum.len() as f64;
            sums[0] += gain;
            sums[1] += n;
            sums[2] += square * g / (g - 1.0).max(1.0);
        }
        let [gain, n, square] = sums;
        let n = n.max(1.0);
        (gain / n, square.sqrt() / n)
    }

    /// Gain over `other` in the tiles that improve, nats per event of all.
    pub(crate) fn gain_over_improved_tiles(
        &self,
        other: &Self,
        part: CellSet,
        n_blocks: usize,
    ) -> f64 {
        let mut tiles = vec![0.0_f64; self.log_likelihood.len().div_ceil(n_blocks)];
        for cell in self.of(part) {
            tiles[cell / n_blocks] += self.log_likelihood[cell] - other.log_likelihood[cell];
        }
        tiles.into_iter().filter(|gain| *gain > 0.0).sum::<f64>() / self.events(part).max(1.0)
    }

    /// These scores in some tiles, and `other`'s elsewhere.
    pub(crate) fn restricted_to(
        mut self,
        other: &Self,
        n_blocks: usize,
        is_here: impl Fn(usize) -> bool,
    ) -> Self {
        for (cell, own) in self.log_likelihood.iter_mut().enumerate() {
            if !is_here(cell / n_blocks) {
                *own = other.log_likelihood[cell];
            }
        }
        self
    }

    fn is_used(&self, cell: usize) -> bool {
        self.log_likelihood[cell] != 0.0
    }
}

/// Scores a hypothesis. The stratum of a pixel is inferred from its training blocks; held-out
/// blocks are predicted from its posterior.
pub(crate) fn score_cells(evidence: &Evidence, hypothesis: &Hypothesis) -> CellScores {
    score_cells_of_each(evidence, &[hypothesis]).remove(0)
}

/// Scores several hypotheses, pixel by pixel, so that hypotheses with the same signal share it.
pub(crate) fn score_cells_of_each(
    evidence: &Evidence,
    hypotheses: &[&Hypothesis],
) -> Vec<CellScores> {
    let mixture: Vec<PixelMixture> = hypotheses.iter().map(|h| h.pixel_mixture()).collect();
    let scores: Vec<Vec<Vec<BlockScore>>> = evidence
        .pixels
        .par_iter()
        .map_init(Vec::new, |scratch, pixel| {
            let mut scorer = PixelScorer::new(evidence, pixel, std::mem::take(scratch));
            let of_each = hypotheses.iter().zip(&mixture);
            let scores = of_each.map(|(h, mixture)| scorer.scores(h, mixture)).collect();
            *scratch = scorer.into_signal();
            scores
        })
        .collect();
    let n = evidence.n_tiles * evidence.blocks.n();
    let held_out: Vec<bool> = (0..n)
        .map(|cell| evidence.is_held_out(cell / evidence.blocks.n(), cell % evidence.blocks.n()))
        .collect();
    (0..hypotheses.len())
        .map(|number| {
            let held_out = held_out.clone();
            let mut cells =
                CellScores { log_likelihood: vec![0.0; n], n_events: vec![0.0; n], held_out };
            for (pixel, scores) in evidence.pixels.iter().zip(&scores) {
                for (block, score) in scores[number].iter().enumerate() {
                    let cell = evidence.cell(pixel, block);
                    cells.log_likelihood[cell] += score.log_likelihood();
                    cells.n_events[cell] += f64::from(score.n_events);
                }
            }
            cells
        })
        .collect()
}

/// Training gain of each pixel, nats.
pub(crate) fn pixel_gains(
    evidence: &Evidence,
    without: &Hypothesis,
    with: &Hypothesis,
) -> Vec<f64> {
    let both = [without, with].map(|hypothesis| (hypothesis, hypothesis.pixel_mixture()));
    let of = |scratch: &mut Vec<f32>, pixel: &PixelEvidence| {
        let mut scorer = PixelScorer::new(evidence, pixel, std::mem::take(scratch));
        let [without, with] = both.each_ref().map(|(hypothesis, mixture)| {
            let scores = scorer.scores(hypothesis, mixture).into_iter().enumerate();
            let training = scores.filter(|(block, _)| !evidence.is_held_out(pixel.tile, *block));
            training.map(|(_, score)| score.log_likelihood()).sum::<f64>()
        });
        *scratch = scorer.into_signal();
        with - without
    };
    evidence.pixels.par_iter().map_init(Vec::new, of).collect()
}
