//! The wide loop: what an interval does to the mean and variance of pixels that cannot fire.

use super::voltages::VoltageColumns;
use crate::voltmeter::coefficients::Coefficients;
use crate::voltmeter::passage::REACH;
use multiversion::multiversion;

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

    /// Moves the pixels that cannot fire and tells which may. All slices are of one length.
    pub(super) fn let_drift(
        &self,
        before: &[f32],
        after: &[f32],
        state: VoltageColumns<'_>,
        may_fire: &mut [bool],
    ) {
        let VoltageColumns { mean, excess, variance } = state;
        drift(self, before, after, mean, excess, variance, may_fire);
    }
}

/// [`IntervalCoefficients::let_drift`], with arguments of which the compiler knows that they do not
/// overlap, so that it works on a register of pixels at a time. No operation is fused or reordered:
/// registers of any width give the same bits.
#[multiversion(targets("x86_64+avx2"))]
fn drift(
    k: &IntervalCoefficients,
    before: &[f32],
    after: &[f32],
    mean: &mut [f32],
    excess: &mut [f32],
    variance: &mut [f32],
    may_fire: &mut [bool],
) {
    let n = may_fire.len();
    let (before, after) = (&before[..n], &after[..n]);
    let (mean, excess, variance) = (&mut mean[..n], &mut excess[..n], &mut variance[..n]);
    for i in 0..n {
        let middle = 0.5 * before[i] + 0.5 * after[i];
        let gain = 1.0 / (middle + k.k2);
        let leak = k.leak + k.bright_leak * middle;
        let by = k.k1 * gain * (after[i] - before[i]) + leak - excess[i];
        let sigma = k.k3 * gain * middle.sqrt() + k.k6;
        let end = mean[i] + by;
        let spread = variance[i] + sigma * sigma * k.span_us;
        let farther = if mean[i].abs() > end.abs() { mean[i].abs() } else { end.abs() };
        let distance = 1.0 - farther;
        let reach = (REACH * REACH) as f32 * spread;
        let is_free = (distance > 0.0) & (reach < distance * distance);
        excess[i] = select(is_free, (end - mean[i]) - by, excess[i]);
        mean[i] = select(is_free, end, mean[i]);
        variance[i] = select(is_free, spread, variance[i]);
        may_fire[i] = !is_free;
    }
}

/// `yes` or `no`, by a mask: from a branch the compiler makes stores that depend on it, one by one.
#[inline(always)]
fn select(condition: bool, yes: f32, no: f32) -> f32 {
    let mask = 0_u32.wrapping_sub(u32::from(condition));
    f32::from_bits(yes.to_bits() & mask | no.to_bits() & !mask)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_stand_for_their_pixels_in_any_number_of_lanes() {
        // One event per log unit: a pixel may fire where brightness doubles and doubles again.
        let k = Coefficients::new([1.0, 1e-6, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let moves = IntervalCoefficients::new(&k, 1_000);
        for n in [1, 7, 8, 9, 63, 64] {
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
                let mut may_fire = vec![false; n];
                moves.let_drift(&before, &after, state, &mut may_fire);
                let expected: Vec<bool> = (0..n).map(|i| i == bright).collect();
                assert_eq!(may_fire, expected, "{n} lanes");
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
            let mut may_fire = [true];
            moves.let_drift(&[5.0], &[5.0], state, &mut may_fire);
            assert!(!may_fire[0]);
        }
        assert!((f64::from(mean[0]) - 0.7).abs() < 1e-6, "{}", mean[0]);
    }
}
