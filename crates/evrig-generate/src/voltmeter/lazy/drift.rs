//! The wide loop: what an interval does to the mean and variance of pixels that cannot fire.

use crate::voltmeter::coefficients::Coefficients;
use crate::voltmeter::passage::REACH;
use wide::f32x8;

/// Pixels of one pass, as many as flags fit a word.
pub(super) const LANES: usize = 64;

/// Pixels of a register.
const EIGHT: usize = 8;

/// The columns of some pixels' state.
pub(super) struct VoltageColumns<'a> {
    pub(super) mean: &'a mut [f32],
    pub(super) excess: &'a mut [f32],
    pub(super) variance: &'a mut [f32],
}

/// Eight pixels of [`VoltageColumns`].
struct VoltageLanes<'a> {
    mean: &'a mut [f32; EIGHT],
    excess: &'a mut [f32; EIGHT],
    variance: &'a mut [f32; EIGHT],
}

impl VoltageColumns<'_> {
    #[inline]
    fn eight(&mut self, i: usize) -> VoltageLanes<'_> {
        VoltageLanes {
            mean: &mut self.mean.as_chunks_mut().0[i],
            excess: &mut self.excess.as_chunks_mut().0[i],
            variance: &mut self.variance.as_chunks_mut().0[i],
        }
    }
}

/// The coefficients for one interval, in f32: a relative error of 3e-7 in drift and
/// diffusion, for twice as many pixels a register.
#[derive(Debug, Clone, Copy)]
pub(super) struct IntervalCoefficients {
    k1: f32,
    k2: f32,
    k3: f32,
    k6: f32,
    /// k4 and k5 times the span.
    leak: f32,
    bright_leak: f32,
    span_us: f32,
}

impl IntervalCoefficients {
    pub(super) fn new(k: &Coefficients, span_us: u32) -> Self {
        let [k1, k2, k3, k4, k5, k6] = k.k();
        let span = f64::from(span_us);
        Self {
            k1: k1 as f32,
            k2: k2 as f32,
            k3: k3 as f32,
            k6: k6 as f32,
            leak: (k4 * span) as f32,
            bright_leak: (k5 * span) as f32,
            span_us: span as f32,
        }
    }

    /// Moves the pixels that cannot fire, up to [`LANES`] of them, and returns a bit for each
    /// that may.
    pub(super) fn let_drift(
        &self,
        before: &[f32],
        after: &[f32],
        mut state: VoltageColumns<'_>,
    ) -> u64 {
        let (before, before_rest) = before.as_chunks::<EIGHT>();
        let (after, after_rest) = after.as_chunks::<EIGHT>();
        let mut flags = 0;
        for (i, (before, after)) in before.iter().zip(after).enumerate() {
            flags |= self.eight(before, after, state.eight(i)) << (EIGHT * i);
        }
        if before_rest.is_empty() {
            return flags;
        }
        // Fewer than eight at the end of a block: the others of the register are dark and still.
        let pad = |rest: &[f32]| {
            let mut eight = [0.0; EIGHT];
            eight[..rest.len()].copy_from_slice(rest);
            eight
        };
        let done = EIGHT * before.len();
        let [mut mean, mut excess, mut variance] =
            [&state.mean, &state.excess, &state.variance].map(|column| pad(&column[done..]));
        let eight = VoltageLanes { mean: &mut mean, excess: &mut excess, variance: &mut variance };
        let n = before_rest.len();
        let last = self.eight(&pad(before_rest), &pad(after_rest), eight) & ((1 << n) - 1);
        state.mean[done..].copy_from_slice(&mean[..n]);
        state.excess[done..].copy_from_slice(&excess[..n]);
        state.variance[done..].copy_from_slice(&variance[..n]);
        flags | last << done
    }

    /// Eight pixels in a register (or two).
    #[inline]
    fn eight(&self, before: &[f32; EIGHT], after: &[f32; EIGHT], state: VoltageLanes<'_>) -> u64 {
        let (before, after) = (f32x8::from(*before), f32x8::from(*after));
        let (mean, excess) = (f32x8::from(*state.mean), f32x8::from(*state.excess));
        let variance = f32x8::from(*state.variance);
        let all = f32x8::splat;
        let middle = all(0.5) * before + all(0.5) * after;
        let gain = all(1.0) / (middle + all(self.k2));
        let leak = all(self.leak) + all(self.bright_leak) * middle;
        let by = all(self.k1) * gain * (after - before) + leak - excess;
        let sigma = all(self.k3) * gain * middle.sqrt() + all(self.k6);
        let end = mean + by;
        let spread = variance + sigma * sigma * all(self.span_us);
        let distance = all(1.0) - mean.abs().fast_max(end.abs());
        let is_near = all((REACH * REACH) as f32) * spread;
        let is_free = distance.simd_gt(all(0.0)) & is_near.simd_lt(distance * distance);
        *state.excess = is_free.select((end - mean) - by, excess).to_array();
        *state.mean = is_free.select(end, mean).to_array();
        *state.variance = is_free.select(spread, variance).to_array();
        u64::from(!is_free.to_bitmask() & 0xFF)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_stand_for_their_pixels_in_any_number_of_lanes() {
        // One event per log unit: a pixel may fire where brightness doubles and doubles again.
        let k = Coefficients::new([1.0, 1e-6, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let moves = IntervalCoefficients::new(&k, 1_000);
        for n in [1, 7, 8, 9, 63, LANES] {
            for bright in 0..n {
                let before = vec![10.0; n];
                let mut after = before.clone();
                after[bright] = 40.0;
                let [mut mean, mut excess, mut variance] = [(); 3].map(|()| vec![0.0; n]);
                let state = VoltageColumns {
                    mean: &mut mean,
                    excess: &mut excess,
                    variance: &mut variance,
                };
                assert_eq!(moves.let_drift(&before, &after, state), 1 << bright, "{n} lanes");
            }
        }
    }

    #[test]
    fn a_million_small_moves_add_up_without_drift() {
        // 1e-7 a µs over intervals of 7 µs: each move is 7e-7, the sum 0.7.
        let k = Coefficients::new([0.0, 1.0, 0.0, 1e-7, 0.0, 0.0]).unwrap();
        let moves = IntervalCoefficients::new(&k, 7);
        let (mut mean, mut excess, mut variance) = ([0.0_f32], [0.0_f32], [0.0_f32]);
        for _ in 0..1_000_000 {
            let state =
                VoltageColumns { mean: &mut mean, excess: &mut excess, variance: &mut variance };
            assert_eq!(moves.let_drift(&[5.0], &[5.0], state), 0);
        }
        assert!((f64::from(mean[0]) - 0.7).abs() < 1e-6, "{}", mean[0]);
    }
}
