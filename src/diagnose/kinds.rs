//! Pixels of several kinds, of which it is not known which is which.

use super::{Evidence, Hypothesis, Kind, PixelEvidence};
use crate::predict::{Bends, BlockScore, Light, score_pixel};
use rayon::prelude::*;
use std::iter::StepBy;
use std::ops::Range;

/// More values than these are steps of a continuous one: every [`STRIDE`]-th, the first and the last
/// among them, is scored, and the scores in between, which bend smoothly, are interpolated.
const MOST_SCORED: usize = 16;
const STRIDE: usize = 8;

/// The least share of a kind: what a pixel's events say must be able to outweigh it.
const LEAST_SHARE: f64 = 1e-12;

/// A likelihood so many nats below the greatest adds nothing.
const BEYOND: f64 = 36.0;

/// A bell is left that low over 17 of its standard deviations: so many values it needs at least.
const LEAST_NODES: usize = 17;

/// The kinds of pixel of a hypothesis. What a pixel is given for On does not touch its Off events
/// given what it memorised, so that each value is scored once, whatever it is paired with.
pub(super) struct Kinds {
    /// Values that a pixel may be given, ascending.
    values: Vec<f64>,
    /// Share of each value for On (row) with each for Off.
    shares: Vec<f64>,
}

impl Kinds {
    pub(super) fn of(hypothesis: &Hypothesis) -> Self {
        Self::new(&hypothesis.kinds())
    }

    /// Of kinds with their shares.
    fn new(kinds: &[(f64, Kind)]) -> Self {
        let mut values: Vec<f64> = kinds.iter().flat_map(|(_, kind)| *kind).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        let place = |value: f64| values.partition_point(|v| *v < value);
        let mut shares = vec![0.0; values.len() * values.len()];
        for (share, [on, off]) in kinds {
            shares[place(*on) * values.len() + place(*off)] += share.max(LEAST_SHARE);
        }
        Self { values, shares }
    }

    /// How many times a pixel is scored.
    pub(super) fn n_scored(&self) -> usize {
        self.values.len().div_ceil(self.stride())
    }

    fn stride(&self) -> usize {
        let n = self.values.len();
        if n > MOST_SCORED && (n - 1).is_multiple_of(STRIDE) { STRIDE } else { 1 }
    }

    /// Logarithm of a pixel's likelihood, given those of its On and its Off events for each value that
    /// is scored.
    fn ln_likelihood(&self, sums: &[Vec<f64>; 2]) -> f64 {
        let n = self.values.len();
        let [on, off] =
            sums.each_ref().map(|scored| Spoken::of(&self.at_all(scored), self.stride()));
        let mut sum = 0.0;
        for (row, weight) in on.at.clone().zip(&on.weights) {
            let shares = &self.shares[row * n..(row + 1) * n];
            let row: f64 = off.at.clone().zip(&off.weights).map(|(at, w)| shares[at] * w).sum();
            sum += weight * row;
        }
        on.most + off.most + sum.max(f64::MIN_POSITIVE).ln()
    }

    /// Scores of every value, given those of the scored ones.
    fn at_all(&self, scored: &[f64]) -> Vec<f64> {
        let stride = self.stride();
        let value = |i: usize| match i % stride {
            0 => scored[i / stride],
            part => cubic(scored, i / stride, part as f64 / stride as f64),
        };
        (0..self.values.len()).map(value).collect()
    }

    /// The kind that those speak for most.
    fn best(&self, sums: &[Vec<f64>; 2]) -> Kind {
        let n = self.values.len();
        let [on, off] = sums.each_ref().map(|scored| self.at_all(scored));
        let log = |at: usize| self.shares[at].ln() + on[at / n] + off[at % n];
        let best = (0..n * n).max_by(|&a, &b| log(a).total_cmp(&log(b))).unwrap_or(0);
        [self.values[best / n], self.values[best % n]]
    }
}

/// What the events of one polarity say of a pixel's value.
struct Spoken {
    /// Logarithm of the greatest likelihood.
    most: f64,
    /// Values that an integral over all of them needs.
    at: StepBy<Range<usize>>,
    /// Likelihood of each over the greatest, times the values that it stands for.
    weights: Vec<f64>,
}

impl Spoken {
    /// Likelihoods that bend smoothly are bells, of which the trapezoidal rule needs but a value a
    /// standard deviation. Values that are scored one by one are needed each: what On events rule out may
    /// be all that Off events leave.
    fn of(logs: &[f64], stride: usize) -> Self {
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let counts = |log: &f64| stride == 1 || *log > most - BEYOND;
        let first = logs.iter().position(counts).unwrap_or(0);
        let end = logs.iter().rposition(counts).map_or(logs.len(), |last| last + 1);
        let wide =
            [4, 2].into_iter().find(|step| stride > *step && (end - first) / step >= LEAST_NODES);
        let step = wide.unwrap_or(1);
        // Steps count from the first value, so that both ends are among them.
        let at = (first.next_multiple_of(step)..end).step_by(step);
        let weights = at.clone().map(|i| (logs[i] - most).exp() * step as f64).collect();
        Self { most, at, weights }
    }
}

/// The kind of each pixel that its training blocks speak for most.
pub(super) fn kinds_of_pixels(evidence: &Evidence, hypothesis: &Hypothesis) -> Vec<Kind> {
    let kinds = Kinds::of(hypothesis);
    if let [only] = kinds.values[..] {
        return vec![[only; 2]; evidence.pixels.len()];
    }
    let of = |pixel: &PixelEvidence| {
        let mut seen = Seen::new(evidence, pixel, Vec::new());
        let by_value = seen.by_value(hypothesis, &kinds);
        let mut sums = [vec![0.0; by_value.len()], vec![0.0; by_value.len()]];
        for block in (0..evidence.blocks.n()).filter(|b| !evidence.is_held_out(pixel.tile, *b)) {
            add(&mut sums, &by_value, block);
        }
        kinds.best(&sums)
    };
    evidence.pixels.par_iter().map(of).collect()
}

/// A pixel with the signal that the last hypothesis made of it.
pub(super) struct Seen<'a> {
    evidence: &'a Evidence,
    pixel: &'a PixelEvidence,
    signal: Vec<f32>,
    bends: Bends,
    of: Option<Hypothesis>,
}

impl<'a> Seen<'a> {
    /// `signal` is memory to use.
    pub(super) fn new(evidence: &'a Evidence, pixel: &'a PixelEvidence, signal: Vec<f32>) -> Self {
        Self { evidence, pixel, signal, bends: Bends::default(), of: None }
    }

    /// The memory again.
    pub(super) fn into_signal(self) -> Vec<f32> {
        self.signal
    }

    /// The pixel's scores, whatever its kind.
    pub(super) fn scores(&mut self, hypothesis: &Hypothesis, kinds: &Kinds) -> Vec<BlockScore> {
        let mut by_value = self.by_value(hypothesis, kinds);
        if kinds.values.len() == 1 {
            return by_value.remove(0);
        }
        let tile = self.pixel.tile;
        mix(kinds, &by_value, |block| self.evidence.is_held_out(tile, block))
    }

    /// The scores with every value that is scored given for both polarities.
    fn by_value(&mut self, hypothesis: &Hypothesis, kinds: &Kinds) -> Vec<Vec<BlockScore>> {
        let scored = kinds.values.iter().step_by(kinds.stride());
        scored.map(|value| self.of_kind(hypothesis, [*value; 2])).collect()
    }

    fn of_kind(&mut self, hypothesis: &Hypothesis, kind: Kind) -> Vec<BlockScore> {
        let signal = std::mem::take(&mut self.signal);
        let view = if self.of.as_ref().is_some_and(|of| of.has_signal_of(hypothesis)) {
            hypothesis.view_with(self.evidence, self.pixel, kind, signal)
        } else {
            self.of = Some(hypothesis.clone());
            let view = hypothesis.view(self.evidence, self.pixel, kind, signal);
            self.bends.set(view.light());
            view
        };
        let light = Light { bends: Some(&self.bends), ..view.light() };
        let scores = score_pixel(&view.law, light, &self.pixel.spikes, &self.evidence.blocks);
        self.signal = view.signal;
        scores
    }
}

/// The scores of a pixel of unknown kind: its training blocks weigh the kinds, one after another,
/// and the held-out blocks are then predicted with those weights. They stand as scores of On.
fn mix(
    kinds: &Kinds,
    by_value: &[Vec<BlockScore>],
    is_held_out: impl Fn(usize) -> bool,
) -> Vec<BlockScore> {
    let n_blocks = by_value.first().map_or(0, Vec::len);
    let mut sums = [vec![0.0; by_value.len()], vec![0.0; by_value.len()]];
    let mut before = kinds.ln_likelihood(&sums);
    let mut mixed = vec![BlockScore::default(); n_blocks];
    for held_out in [false, true] {
        for block in (0..n_blocks).filter(|&block| is_held_out(block) == held_out) {
            add(&mut sums, by_value, block);
            let now = kinds.ln_likelihood(&sums);
            let n_events = by_value[0][block].n_events;
            mixed[block] = BlockScore { on_off: [now - before, 0.0], n_events };
            before = now;
        }
    }
    mixed
}

/// Adds what a block scores for each value that is scored, On and Off.
fn add(sums: &mut [Vec<f64>; 2], by_value: &[Vec<BlockScore>], block: usize) {
    for (polarity, sums) in sums.iter_mut().enumerate() {
        for (sum, scores) in sums.iter_mut().zip(by_value) {
            *sum += scores[block].on_off[polarity];
        }
    }
}

/// A share of the way from the value `left` to the next, by the cubic through the two on either side; at
/// the ends by the parabola through three.
fn cubic(at: &[f64], left: usize, t: f64) -> f64 {
    let (b, c) = (at[left], at[left + 1]);
    let beyond = |near: f64, next: f64, far: f64| 3.0 * near - 3.0 * next + far;
    let a = if left > 0 { at[left - 1] } else { beyond(b, c, at[left + 2]) };
    let d = if left + 2 < at.len() { at[left + 2] } else { beyond(c, b, at[left - 1]) };
    let third = |x: f64, y: f64, z: f64| x * y * z;
    -third(t, t - 1.0, t - 2.0) / 6.0 * a + third(t + 1.0, t - 1.0, t - 2.0) / 2.0 * b
        - third(t + 1.0, t, t - 2.0) / 2.0 * c
        + third(t + 1.0, t, t - 1.0) / 6.0 * d
}

#[cfg(test)]
mod tests {
    use super::super::candidate::LIBRARY;
    use super::*;
    use crate::effect_id::EffectId;

    #[test]
    fn scores_between_values_are_those_of_a_smooth_curve() {
        let parabola = |x: f64| 3.0 - 2.0 * x + 0.7 * x * x;
        let five: Vec<f64> = (0..5).map(|i| parabola(f64::from(i))).collect();
        for left in 0..4 {
            for t in [0.25, 0.5, 0.75] {
                let got = cubic(&five, left, t);
                assert!((got - parabola(left as f64 + t)).abs() < 1e-12, "{left} {t}");
            }
        }
    }

    /// Steps of normal thresholds, On and Off apart.
    fn continuous() -> Kinds {
        let mismatch = LIBRARY.into_iter().find(|c| c.id == EffectId::ThresholdMismatch).unwrap();
        Kinds::new(&mismatch.mixture.unwrap()(&[0.1, 0.0]))
    }

    #[test]
    fn values_that_are_passed_over_change_nothing() {
        let kinds = continuous();
        let width = |w: f64, middle: f64| -> Vec<f64> {
            let scored = kinds.values.iter().step_by(STRIDE);
            scored.map(|v| 7.0 - 0.5 * ((v - middle) / w).powi(2)).collect()
        };
        let mut sparse = 0;
        for w in [0.1, 0.2, 0.35, 0.6, 1.0, 3.0, 1e6] {
            for middle in [-2.6, -0.93, 0.0, 1.71] {
                let [on, off] = [width(w, middle), width(0.5, 0.3)];
                let each = |logs: &[f64]| -> f64 {
                    let logs = kinds.at_all(logs).into_iter();
                    logs.enumerate().map(|(i, log)| kinds.shares[97 * 48 + i] * log.exp()).sum()
                };
                let middle_share: f64 = (0..97).map(|i| kinds.shares[97 * 48 + i]).sum();
                let expected = (each(&on) / middle_share).ln() + (each(&off) / middle_share).ln();
                sparse += Spoken::of(&kinds.at_all(&on), STRIDE).weights.len();
                let got = kinds.ln_likelihood(&[on, off]);
                assert!((got - expected).abs() < 2e-3, "{w} {middle}: {got} {expected}");
            }
        }
        assert!(sparse < 28 * 30, "{sparse} values for 28 likelihoods");
    }

    /// Kinds of three values, a quarter, a half and a quarter, alike or apart for both polarities.
    fn kinds(is_one: bool) -> Kinds {
        let own = [0.25, 0.5, 0.25];
        let share = |on: usize, off: usize| match is_one {
            true => {
                if on == off {
                    own[on]
                } else {
                    0.0
                }
            }
            false => own[on] * own[off],
        };
        let shares = (0..9).map(|at| share(at / 3, at % 3)).collect();
        Kinds { values: vec![-1.0, 0.0, 1.0], shares }
    }

    #[test]
    fn what_training_says_of_a_pixel_predicts_the_rest() {
        let score = |on: f64, off: f64| BlockScore { on_off: [on, off], n_events: 1 };
        // On events speak for the third value, Off events for the first.
        let by_value =
            vec![vec![score(0.0, 4.0); 2], vec![score(1.0, 1.0); 2], vec![score(4.0, 0.0); 2]];
        for (is_one, best) in [(true, 3.891), (false, 7.787)] {
            let mixed = mix(&kinds(is_one), &by_value, |block| block == 1);
            assert!(mixed[0].log_likelihood() < mixed[1].log_likelihood(), "{mixed:?}");
            assert!((mixed[1].log_likelihood() - best).abs() < 0.01, "{is_one}: {mixed:?}");
        }
        let sums = [vec![0.0, 2.0, 8.0], vec![8.0, 2.0, 0.0]];
        assert_eq!(kinds(false).best(&sums), [1.0, -1.0]);
    }

    #[test]
    fn kinds_of_which_each_polarity_rules_out_another_are_weighed_all_the_same() {
        let sums = [vec![-60.0, -100.0, 0.0], vec![0.0, -100.0, -50.0]];
        let got = kinds(true).ln_likelihood(&sums);
        assert!((got - (-50.0 + 0.25_f64.ln())).abs() < 1e-3, "{got}");
    }
}
