//! What a hypothesis scores, cell by cell: a cell is a tile of pixels during a block of time.

use super::kinds::{Kinds, Seen};
use super::{Evidence, Hypothesis};
use crate::predict::BlockScore;
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
    cells_of_each(evidence, &[hypothesis]).remove(0)
}

/// The same for several hypotheses at once: pixel by pixel, so that those which leave a pixel's
/// signal alike share it.
pub(super) fn cells_of_each(evidence: &Evidence, hypotheses: &[&Hypothesis]) -> Vec<Cells> {
    let kinds: Vec<Kinds> = hypotheses.iter().map(|h| Kinds::of(h)).collect();
    let scores: Vec<Vec<Vec<BlockScore>>> = evidence
        .pixels
        .par_iter()
        .map_init(Vec::new, |scratch, pixel| {
            let mut seen = Seen::new(evidence, pixel, std::mem::take(scratch));
            let of_each = hypotheses.iter().zip(&kinds);
            let scores = of_each.map(|(h, kinds)| seen.scores(h, kinds)).collect();
            *scratch = seen.into_signal();
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
                Cells { log_likelihood: vec![0.0; n], n_events: vec![0.0; n], held_out };
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
