//! What a hypothesis scores, cell by cell: a cell is a tile of pixels during a block of time.

use super::{Evidence, Hypothesis, Kind, PixelEvidence};
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
            let mut seen = Seen { evidence, pixel, signal: std::mem::take(scratch), of: None };
            let of_each = hypotheses.iter().zip(&kinds);
            let scores = of_each.map(|(h, kinds)| seen.scores(h, kinds)).collect();
            *scratch = seen.signal;
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

/// The kind of each pixel that its training blocks speak for most.
pub(super) fn kinds_of_pixels(evidence: &Evidence, hypothesis: &Hypothesis) -> Vec<Kind> {
    let kinds = Kinds::of(hypothesis);
    if let [only] = kinds.pairs[..] {
        return vec![kinds.kind(only); evidence.pixels.len()];
    }
    evidence
        .pixels
        .par_iter()
        .map(|pixel| {
            let mut seen = Seen { evidence, pixel, signal: Vec::new(), of: None };
            let by_value = seen.by_value(hypothesis, &kinds);
            let own = by_value.iter().map(|scores| {
                let training = scores.iter().enumerate();
                let training =
                    training.filter(|(block, _)| !evidence.is_held_out(pixel.tile, *block));
                training.fold([0.0; 2], |sum, (_, s)| [0, 1].map(|i| sum[i] + s.on_off[i]))
            });
            let own: Vec<[f64; 2]> = own.collect();
            let weight = |pair: &Pair| pair.ln_share + own[pair.on][0] + own[pair.off][1];
            let best = kinds.pairs.iter().max_by(|a, b| weight(a).total_cmp(&weight(b)));
            best.map_or([0.0; 2], |best| kinds.kind(*best))
        })
        .collect()
}

/// The kinds of pixel of a hypothesis. What a pixel is given for On does not touch its Off events
/// given what it memorised, so that each value is scored once, whatever it is paired with.
struct Kinds {
    values: Vec<f64>,
    pairs: Vec<Pair>,
}

/// A kind of pixel: the places of its two values.
#[derive(Clone, Copy)]
struct Pair {
    on: usize,
    off: usize,
    ln_share: f64,
}

impl Kinds {
    fn of(hypothesis: &Hypothesis) -> Self {
        let kinds = hypothesis.kinds();
        let mut values: Vec<f64> = kinds.iter().flat_map(|(_, kind)| *kind).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        let place = |value: f64| values.partition_point(|v| *v < value);
        let pairs = kinds.iter().map(|(share, [on, off])| Pair {
            on: place(*on),
            off: place(*off),
            ln_share: share.max(1e-12).ln(),
        });
        Self { pairs: pairs.collect(), values }
    }

    fn kind(&self, pair: Pair) -> Kind {
        [self.values[pair.on], self.values[pair.off]]
    }
}

/// A pixel with the signal that the last hypothesis made of it.
struct Seen<'a> {
    evidence: &'a Evidence,
    pixel: &'a PixelEvidence,
    signal: Vec<f32>,
    of: Option<Hypothesis>,
}

impl Seen<'_> {
    fn scores(&mut self, hypothesis: &Hypothesis, kinds: &Kinds) -> Vec<BlockScore> {
        let mut by_value = self.by_value(hypothesis, kinds);
        if by_value.len() == 1 {
            return by_value.remove(0);
        }
        let tile = self.pixel.tile;
        mix(&kinds.pairs, &by_value, |block| self.evidence.is_held_out(tile, block))
    }

    /// The scores with each value of the kinds given for both polarities.
    fn by_value(&mut self, hypothesis: &Hypothesis, kinds: &Kinds) -> Vec<Vec<BlockScore>> {
        kinds.values.iter().map(|value| self.of_kind(hypothesis, [*value; 2])).collect()
    }

    fn of_kind(&mut self, hypothesis: &Hypothesis, kind: Kind) -> Vec<BlockScore> {
        let signal = std::mem::take(&mut self.signal);
        let view = if self.of.as_ref().is_some_and(|of| of.has_signal_of(hypothesis)) {
            hypothesis.view_with(self.evidence, self.pixel, kind, signal)
        } else {
            self.of = Some(hypothesis.clone());
            hypothesis.view(self.evidence, self.pixel, kind, signal)
        };
        let scores =
            score_pixel(&view.law, view.light(), &self.pixel.spikes, &self.evidence.blocks);
        self.signal = view.signal;
        scores
    }
}

/// The scores of a pixel of unknown kind: its training blocks weigh the kinds, one after another,
/// and the held-out blocks are then predicted with those weights. They stand as scores of On.
fn mix(
    pairs: &[Pair],
    by_value: &[Vec<BlockScore>],
    is_held_out: impl Fn(usize) -> bool,
) -> Vec<BlockScore> {
    let n_blocks = by_value.first().map_or(0, Vec::len);
    let mut weights: Vec<f64> = pairs.iter().map(|pair| pair.ln_share).collect();
    let mut mixed = vec![BlockScore::default(); n_blocks];
    for held_out in [false, true] {
        for block in (0..n_blocks).filter(|&block| is_held_out(block) == held_out) {
            let before = log_sum(&weights);
            for (weight, pair) in weights.iter_mut().zip(pairs) {
                *weight += by_value[pair.on][block].on_off[0] + by_value[pair.off][block].on_off[1];
            }
            let n_events = by_value[0][block].n_events;
            mixed[block] = BlockScore { on_off: [log_sum(&weights) - before, 0.0], n_events };
        }
    }
    mixed
}

fn log_sum(logs: &[f64]) -> f64 {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + logs.iter().map(|log| (log - most).exp()).sum::<f64>().ln()
}
