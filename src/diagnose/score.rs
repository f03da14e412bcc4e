//! What a hypothesis scores, cell by cell: a cell is a tile of pixels during a block of time.

use super::{Evidence, Hypothesis, PixelEvidence};
use crate::predict::{BlockScore, score_pixel};
use rayon::prelude::*;

/// Log-likelihoods and events of all cells.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    /// Log-likelihood by cell.
    pub(super) log_likelihood: Vec<f64>,
    /// Events by cell.
    pub(super) n_events: Vec<f64>,
    held_out: Vec<bool>,
}

/// Which cells a sum is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Training,
    HeldOut,
}

impl Cells {
    /// Cells of one part.
    pub(super) fn of(&self, part: Part) -> impl Iterator<Item = usize> + '_ {
        let wanted = part == Part::HeldOut;
        (0..self.held_out.len()).filter(move |&cell| self.held_out[cell] == wanted)
    }

    /// Nats an event over one part.
    pub(super) fn nats(&self, part: Part) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for cell in self.of(part) {
            sum += self.log_likelihood[cell];
            n += self.n_events[cell];
        }
        sum / f64::max(n, 1.0)
    }

    /// How much better than `other` on one part, nats an event, with its error from the scatter
    /// over cells.
    pub(super) fn gain(&self, other: &Self, part: Part) -> (f64, f64) {
        let cells: Vec<usize> =
            self.of(part).filter(|&c| self.is_used(c) || other.is_used(c)).collect();
        let n: f64 = cells.iter().map(|&c| self.n_events[c]).sum::<f64>().max(1.0);
        let differences: Vec<(f64, f64)> = cells
            .iter()
            .map(|&c| (self.log_likelihood[c] - other.log_likelihood[c], self.n_events[c]))
            .collect();
        let gain = differences.iter().map(|d| d.0).sum::<f64>() / n;
        // Ratio estimate over clusters (Cochran, Sampling Techniques, 1977, section 6.4).
        let square: f64 = differences.iter().map(|d| (d.0 - gain * d.1).powi(2)).sum();
        let g = differences.len() as f64;
        (gain, (square * g / (g - 1.0).max(1.0)).sqrt() / n)
    }

    fn is_used(&self, cell: usize) -> bool {
        self.log_likelihood[cell] != 0.0
    }
}

/// Scores the evidence under a hypothesis. A pixel of a mixture is of the kind that its own
/// training blocks speak for; those held out are predicted with what they say.
pub(super) fn cells(evidence: &Evidence, hypothesis: &Hypothesis) -> Cells {
    let kinds = hypothesis.kinds();
    let scores: Vec<Vec<BlockScore>> = evidence
        .pixels
        .par_iter()
        .map_init(Vec::new, |scratch, pixel| of_pixel(evidence, hypothesis, &kinds, pixel, scratch))
        .collect();
    let n = evidence.n_tiles * evidence.blocks.n();
    let held_out = (0..n)
        .map(|cell| evidence.is_held_out(cell / evidence.blocks.n(), cell % evidence.blocks.n()))
        .collect();
    let mut cells = Cells { log_likelihood: vec![0.0; n], n_events: vec![0.0; n], held_out };
    for (pixel, scores) in evidence.pixels.iter().zip(scores) {
        for (block, score) in scores.iter().enumerate() {
            let cell = evidence.cell(pixel, block);
            cells.log_likelihood[cell] += score.log_likelihood;
            cells.n_events[cell] += f64::from(score.n_events);
        }
    }
    cells
}

fn of_pixel(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    kinds: &[(f64, f64)],
    pixel: &PixelEvidence,
    scratch: &mut Vec<f32>,
) -> Vec<BlockScore> {
    let mut one = |kind: f64| {
        let view = hypothesis.view(evidence, pixel, kind, std::mem::take(scratch));
        let scores = score_pixel(&view.law, view.light(), &pixel.spikes, &evidence.blocks);
        *scratch = view.signal;
        scores
    };
    if let [(_, kind)] = kinds {
        return one(*kind);
    }
    let by_kind: Vec<Vec<BlockScore>> = kinds.iter().map(|(_, kind)| one(*kind)).collect();
    mix(kinds, &by_kind, |block| evidence.is_held_out(pixel.tile, block))
}

/// The scores of a pixel of unknown kind: its training blocks weigh the kinds, one after another,
/// and the held-out blocks are then predicted with those weights.
fn mix(
    kinds: &[(f64, f64)],
    by_kind: &[Vec<BlockScore>],
    is_held_out: impl Fn(usize) -> bool,
) -> Vec<BlockScore> {
    let n_blocks = by_kind.first().map_or(0, Vec::len);
    let mut weights: Vec<f64> = kinds.iter().map(|(share, _)| share.max(1e-12).ln()).collect();
    let mut mixed = vec![BlockScore::default(); n_blocks];
    for held_out in [false, true] {
        for block in (0..n_blocks).filter(|&block| is_held_out(block) == held_out) {
            let joint: Vec<f64> =
                weights.iter().zip(by_kind).map(|(w, s)| w + s[block].log_likelihood).collect();
            let before = log_sum(&weights);
            mixed[block] = BlockScore {
                log_likelihood: log_sum(&joint) - before,
                n_events: by_kind[0][block].n_events,
            };
            weights = joint;
        }
    }
    mixed
}

fn log_sum(logs: &[f64]) -> f64 {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + logs.iter().map(|log| (log - most).exp()).sum::<f64>().ln()
}
