//! What a pixel scores as a function of a value of its own, from as few scorings as its course needs.
//!
//! Where thresholds are sharp, a pixel's events tell its own within a fraction of what the thresholds of
//! all scatter by, so that no even step fits all pixels: the gaps about the greatest likelihood are
//! halved until a cubic foretells what the next halving finds.

use crate::predict::BlockScore;

/// Values from one that is scored to the next at the begin.
pub(super) const WIDEST: usize = 32;

/// A log-likelihood that was foretold this well, nats, is known.
const KNOWN: f64 = 0.1;

/// A likelihood so many nats below the greatest need not be known.
const NEGLIGIBLE: f64 = 8.0;

/// What the score at each of some values at even steps is made of.
#[derive(Debug)]
pub(super) struct Curve {
    parts: Vec<[(usize, f64); 4]>,
}

impl Curve {
    /// Of `n` values that are scored each.
    pub(super) fn of_each(n: usize) -> Self {
        Self { parts: (0..n).map(only).collect() }
    }

    /// Of `n` values every so many-th of which is scored, the first and the last among them.
    pub(super) fn of_some(n: usize, every: usize) -> Self {
        let scored: Vec<usize> = (0..n).step_by(every).collect();
        Self::through(&scored, &vec![true; scored.len() - 1])
    }

    /// Of values some of which were scored. Between these lies a cubic where that is known to be near,
    /// else a straight line, which lies below a likelihood that has but one summit.
    fn through(scored: &[usize], is_known: &[bool]) -> Self {
        let mut parts = Vec::new();
        for (gap, ends) in scored.windows(2).enumerate() {
            parts.push(only(gap));
            for value in ends[0] + 1..ends[1] {
                parts.push(if is_known[gap] {
                    cubic(scored, gap, value)
                } else {
                    straight(scored, gap, value)
                });
            }
        }
        parts.push(only(scored.len() - 1));
        Self { parts }
    }

    /// Scores of every value, given those of the scored ones.
    pub(super) fn at_all(&self, scored: &[f64]) -> Vec<f64> {
        let sum = |part: &[(usize, f64); 4]| part.iter().map(|(i, share)| scored[*i] * share).sum();
        self.parts.iter().map(sum).collect()
    }
}

/// Scores as many of `n` values as both polarities' courses need. `n` is one more than some times
/// [`WIDEST`].
pub(super) fn scored(
    n: usize,
    mut score: impl FnMut(usize) -> Vec<BlockScore>,
) -> (Curve, Vec<Vec<BlockScore>>) {
    let mut at: Vec<usize> = (0..n).step_by(WIDEST).collect();
    let mut scores: Vec<Vec<BlockScore>> = at.iter().map(|value| score(*value)).collect();
    let mut totals: Vec<[f64; 2]> = scores.iter().map(|blocks| total(blocks)).collect();
    let mut is_known = vec![false; at.len() - 1];
    let is_open =
        |at: &[usize], is_known: &[bool], gap: usize| !is_known[gap] && at[gap + 1] > at[gap] + 1;
    while let Some((gap, matters)) = (0..is_known.len())
        .filter(|&gap| is_open(&at, &is_known, gap))
        .map(|gap| (gap, [0, 1].map(|side| matters(&totals, gap, side))))
        .find(|(_, matters)| matters.contains(&true))
    {
        let middle = usize::midpoint(at[gap], at[gap + 1]);
        let found = score(middle);
        let there = total(&found);
        let is_foretold = |side: usize| {
            let parts = cubic(&at, gap, middle);
            let foretold: f64 = parts.iter().map(|(i, share)| totals[*i][side] * share).sum();
            (foretold - there[side]).abs() < KNOWN
        };
        let is_now = [0, 1].into_iter().all(|side| !matters[side] || is_foretold(side));
        is_known[gap] = is_now;
        is_known.insert(gap, is_now);
        at.insert(gap + 1, middle);
        scores.insert(gap + 1, found);
        totals.insert(gap + 1, there);
    }
    (Curve::through(&at, &is_known), scores)
}

fn total(blocks: &[BlockScore]) -> [f64; 2] {
    [0, 1].map(|side| blocks.iter().map(|block| block.on_off[side]).sum())
}

/// Whether a likelihood has its greatest values, or some that are not much less, in a gap.
fn matters(totals: &[[f64; 2]], gap: usize, side: usize) -> bool {
    let most = totals.iter().map(|total| total[side]).fold(f64::NEG_INFINITY, f64::max);
    totals[gap..=gap + 1].iter().any(|end| end[side] > most - NEGLIGIBLE)
}

fn only(scored: usize) -> [(usize, f64); 4] {
    [(scored, 1.0), (scored, 0.0), (scored, 0.0), (scored, 0.0)]
}

fn straight(scored: &[usize], gap: usize, value: usize) -> [(usize, f64); 4] {
    let [from, to] = [scored[gap] as f64, scored[gap + 1] as f64];
    let share = (value as f64 - from) / (to - from);
    [(gap, 1.0 - share), (gap + 1, share), (gap, 0.0), (gap, 0.0)]
}

/// By the cubic through the two scored values on either side; at the ends through the nearest four.
fn cubic(scored: &[usize], gap: usize, value: usize) -> [(usize, f64); 4] {
    let first = gap.saturating_sub(1).min(scored.len() - 4);
    let at = |i: usize| scored[first + i] as f64;
    [0, 1, 2, 3].map(|i| {
        let others = (0..4).filter(|&j| j != i);
        let share: f64 = others.map(|j| (value as f64 - at(j)) / (at(i) - at(j))).product();
        (first + i, share)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Scores of one block whose polarities have their summits at two values, each falling off over
    /// `width` as the logarithm of a logistic law does.
    fn peaked(width: f64) -> impl Fn(usize) -> Vec<BlockScore> {
        move |value| {
            let log = |summit: f64| {
                let z = (value as f64 - summit) / width;
                -25.0 * (z.abs() + 2.0 * (-z.abs()).exp().ln_1p())
            };
            vec![BlockScore { on_off: [log(117.3), log(158.9)], n_events: 50 }]
        }
    }

    #[test]
    fn what_matters_of_a_likelihood_is_known_however_sharp_it_is() {
        for width in [2.0, 5.0, 12.0, 40.0, 160.0, 1e4] {
            let exact = peaked(width);
            let (curve, scores) = scored(257, &exact);
            let n_scored = scores.len();
            for side in [0, 1] {
                let given: Vec<f64> = scores.iter().map(|blocks| blocks[0].on_off[side]).collect();
                let expected: Vec<f64> = (0..257).map(|i| exact(i)[0].on_off[side]).collect();
                let sum = |logs: &[f64]| logs.iter().map(|log| log.exp()).sum::<f64>().ln();
                let (got, expected) = (sum(&curve.at_all(&given)), sum(&expected));
                assert!((got - expected).abs() < 0.03, "{width} {side}: {got} {expected}");
            }
            assert!(n_scored <= if width > 1e3 { 17 } else { 36 }, "{width}: {n_scored}");
        }
    }

    #[test]
    fn a_cubic_is_found_again_between_uneven_values() {
        let value = |x: f64| 3.0 - 2.0 * x + 0.7 * x * x - 0.01 * x * x * x;
        let scored = [0, 2, 3, 8, 16];
        let given: Vec<f64> = scored.iter().map(|&x| value(f64::from(x))).collect();
        let all = Curve::through(&scored.map(|x| x as usize), &[true; 4]).at_all(&given);
        for (x, got) in all.iter().enumerate() {
            assert!((got - value(x as f64)).abs() < 1e-9, "{x}: {got}");
        }
        assert_eq!(Curve::of_each(3).at_all(&[1.0, 5.0, 2.0]), [1.0, 5.0, 2.0]);
    }
}
