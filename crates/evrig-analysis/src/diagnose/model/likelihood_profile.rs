//! A pixel's likelihood as a function of its own parameter value, from few evaluations.
//!
//! For sharp thresholds a pixel's events resolve its own value much better than the spread over
//! pixels, so that no uniform grid fits all pixels. Gaps around the maximum are halved until cubic
//! interpolation predicts the next evaluation.

use crate::predict::BlockScore;

/// Gaps between the first scored values.
const N_FIRST_GAPS: usize = 8;

/// A gap whose midpoint is predicted this well is not halved.
const MAX_PREDICTION_ERROR_NATS: f64 = 0.1;

/// Values this far below the maximum need no refinement.
const NEGLIGIBLE_NATS: f64 = 8.0;

/// Interpolation weights for each value of a uniform grid.
#[derive(Debug, Clone)]
pub(crate) struct LikelihoodProfile {
    scored: Vec<usize>,
    parts: Vec<[(usize, f64); 4]>,
}

impl LikelihoodProfile {
    /// Every `every`-th of `n` values, the first and the last among them.
    pub(crate) fn every_nth(n: usize, every: usize) -> Self {
        let scored: Vec<usize> = (0..n).step_by(every).collect();
        Self::through(&scored, &vec![true; scored.len() - 1])
    }

    /// Through some values. Gaps that are known use a cubic, others a straight line, which lies
    /// below a unimodal likelihood.
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
        Self { scored: scored.to_vec(), parts }
    }

    /// Evaluated values, ascending.
    pub(crate) fn scored(&self) -> &[usize] {
        &self.scored
    }

    /// Scores of all values from those of the evaluated ones.
    pub(crate) fn interpolate(&self, scored: &[f64]) -> Vec<f64> {
        let sum = |part: &[(usize, f64); 4]| part.iter().map(|(i, share)| scored[*i] * share).sum();
        self.parts.iter().map(sum).collect()
    }
}

struct LikelihoodPoint {
    value: usize,
    blocks: Vec<BlockScore>,
    /// Over all blocks, ON and OFF.
    total: [f64; 2],
    /// Whether the gap to the next point is predicted well.
    is_known: bool,
}

impl LikelihoodPoint {
    fn new(value: usize, blocks: Vec<BlockScore>) -> Self {
        Self { value, total: total(&blocks), blocks, is_known: false }
    }
}

/// A value's score over all blocks, ON and OFF.
pub(crate) fn total(blocks: &[BlockScore]) -> [f64; 2] {
    [0, 1].map(|side| blocks.iter().map(|block| block.on_off[side]).sum())
}

/// Per value: whether the ON and the OFF likelihood lie less than `nats` below their maxima.
pub(crate) fn likely(totals: &[[f64; 2]], nats: f64) -> Vec<[bool; 2]> {
    let of = |side: usize| totals.iter().map(move |total| total[side]);
    let most = [0, 1].map(|side| of(side).fold(f64::NEG_INFINITY, f64::max));
    totals.iter().map(|total| [0, 1].map(|side| total[side] > most[side] - nats)).collect()
}

/// Evaluates as many of `n` values as both polarities need; `n` is one more than a multiple of the
/// first gaps.
pub(crate) fn score_profile(
    n: usize,
    mut score: impl FnMut(usize) -> Vec<BlockScore>,
) -> (LikelihoodProfile, Vec<Vec<BlockScore>>) {
    let mut point = |value: usize| LikelihoodPoint::new(value, score(value));
    let mut points: Vec<LikelihoodPoint> =
        (0..n).step_by(n / N_FIRST_GAPS).map(&mut point).collect();
    while let Some((gap, matters)) = to_halve(&points) {
        let values: Vec<usize> = points.iter().map(|point| point.value).collect();
        let middle = usize::midpoint(values[gap], values[gap + 1]);
        let mut found = point(middle);
        let parts = cubic(&values, gap, middle);
        let is_foretold = |side: usize| {
            let foretold: f64 = parts.iter().map(|(i, share)| points[*i].total[side] * share).sum();
            (foretold - found.total[side]).abs() < MAX_PREDICTION_ERROR_NATS
        };
        found.is_known = [0, 1].into_iter().all(|side| !matters[side] || is_foretold(side));
        points[gap].is_known = found.is_known;
        points.insert(gap + 1, found);
    }
    let (values, is_known): (Vec<usize>, Vec<bool>) =
        points.iter().map(|point| (point.value, point.is_known)).unzip();
    (
        LikelihoodProfile::through(&values, &is_known),
        points.into_iter().map(|point| point.blocks).collect(),
    )
}

/// The first unknown gap near the maximum of either polarity, and which polarities need it.
fn to_halve(points: &[LikelihoodPoint]) -> Option<(usize, [bool; 2])> {
    let totals: Vec<[f64; 2]> = points.iter().map(|point| point.total).collect();
    let likely = likely(&totals, NEGLIGIBLE_NATS);
    let is_open =
        |gap: &usize| !points[*gap].is_known && points[gap + 1].value > points[*gap].value + 1;
    (0..points.len() - 1)
        .filter(is_open)
        .map(|gap| (gap, [0, 1].map(|side| likely[gap][side] || likely[gap + 1][side])))
        .find(|(_, matters)| matters.contains(&true))
}

fn only(scored: usize) -> [(usize, f64); 4] {
    [(scored, 1.0), (scored, 0.0), (scored, 0.0), (scored, 0.0)]
}

fn straight(scored: &[usize], gap: usize, value: usize) -> [(usize, f64); 4] {
    let [from, to] = [scored[gap] as f64, scored[gap + 1] as f64];
    let share = (value as f64 - from) / (to - from);
    [(gap, 1.0 - share), (gap + 1, share), (gap, 0.0), (gap, 0.0)]
}

/// Cubic through the two evaluated values on either side; at the ends through the nearest four.
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

    /// Scores of one block whose polarities peak at two values, with logistic tails of `width`.
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
    fn a_profile_integrates_correctly_for_any_width() {
        for width in [2.0, 5.0, 12.0, 40.0, 160.0, 1e4] {
            let exact = peaked(width);
            let (curve, scores) = score_profile(257, &exact);
            let n_scored = scores.len();
            for side in [0, 1] {
                let given: Vec<f64> = scores.iter().map(|blocks| blocks[0].on_off[side]).collect();
                let expected: Vec<f64> = (0..257).map(|i| exact(i)[0].on_off[side]).collect();
                let sum = |logs: &[f64]| logs.iter().map(|log| log.exp()).sum::<f64>().ln();
                let (got, expected) = (sum(&curve.interpolate(&given)), sum(&expected));
                assert!((got - expected).abs() < 0.03, "{width} {side}: {got} {expected}");
            }
            assert!(n_scored <= if width > 1e3 { 17 } else { 36 }, "{width}: {n_scored}");
        }
    }

    #[test]
    fn a_cubic_is_interpolated_exactly_between_uneven_values() {
        let value = |x: f64| 3.0 - 2.0 * x + 0.7 * x * x - 0.01 * x * x * x;
        let scored = [0, 2, 3, 8, 16];
        let given: Vec<f64> = scored.iter().map(|&x| value(f64::from(x))).collect();
        let all =
            LikelihoodProfile::through(&scored.map(|x| x as usize), &[true; 4]).interpolate(&given);
        for (x, got) in all.iter().enumerate() {
            assert!((got - value(x as f64)).abs() < 1e-9, "{x}: {got}");
        }
        assert_eq!(
            LikelihoodProfile::every_nth(3, 1).interpolate(&[1.0, 5.0, 2.0]),
            [1.0, 5.0, 2.0]
        );
    }
}
