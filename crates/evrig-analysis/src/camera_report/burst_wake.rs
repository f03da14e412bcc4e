//! The rate of a burst's polarity after the burst, as pixels that were reset recover.

use super::burst_shape::BurstShape;
use super::chance::{LEVEL, excess_z, normal_tail};
use super::frame_fold::FrameFold;
use evrig_core::event::EventSlice;
use evrig_core::stats::{Estimate, Moments, SplitMix};
use serde::Serialize;

/// Time after the burst that is looked at, as a share of the frame period and at most, µs. The
/// second half is the usual rate.
const MAX_PERIOD_SHARE: f64 = 0.2;
const MAX_RANGE_US: f64 = 10_000.0;

/// Bins of that time.
const N_BINS: usize = 80;

/// Time constants and depths that are tried: steps below the errors of a thousand events.
const N_TIME_CONSTANTS: usize = 48;
const N_DEPTHS: usize = 40;

const N_RESAMPLES: usize = 60;

/// A lower rate after a burst: `1 - depth * exp(-t / recovery)` of the usual one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BurstWake {
    /// Share of the usual rate that is missing right after the burst.
    pub depth: Estimate,
    /// Time constant with which the rate recovers, µs.
    pub recovery_us: Estimate,
    /// Deficit, standard errors.
    pub z: f64,
}

/// The deficit after a burst; `None` where there is none.
pub(super) fn wake(
    events: EventSlice<'_>,
    fold: &FrameFold<'_>,
    on: bool,
    shape: &BurstShape,
) -> Option<BurstWake> {
    let range_us = MAX_RANGE_US.min(MAX_PERIOD_SHARE * fold.period_us);
    let bin_us = range_us / N_BINS as f64;
    let [delay, row, end] = [shape.delay_us.value, shape.row_us.value, shape.window_us[1]];
    let mut counts = vec![0.0; N_BINS];
    fold.visit(events.t, |i, _, since| {
        if events.on[i] != on {
            return;
        }
        let after = fold.wrap(since - delay - row * f64::from(events.y[i])) - end;
        if after >= 0.0 && after < range_us {
            counts[((after / bin_us) as usize).min(N_BINS - 1)] += 1.0;
        }
    });
    let (first, second) = counts.split_at(N_BINS / 2);
    let [n_first, usual]: [f64; 2] = [first, second].map(|half| half.iter().sum());
    let z = excess_z(n_first, usual, 1.0);
    if normal_tail(-z) > LEVEL {
        return None;
    }
    let [depth, recovery_us] = fit(&counts, bin_us)?;
    let mut spread = [Moments::default(), Moments::default()];
    let mut random = SplitMix::new(2, usual as u64);
    for _ in 0..N_RESAMPLES {
        let resampled: Vec<f64> =
            counts.iter().map(|n: &f64| (n + n.sqrt() * random.normal()).max(0.0)).collect();
        if let Some(values) = fit(&resampled, bin_us) {
            spread.iter_mut().zip(values).for_each(|(moments, value)| moments.push(value));
        }
    }
    let n = n_first as u64;
    let [depth_error, recovery_error] = spread.map(|moments| moments.standard_deviation());
    // A grid of depths and time constants resolves no less than a step.
    let recovery_error = recovery_error.max(0.03 * recovery_us);
    Some(BurstWake {
        depth: Estimate::normal(depth, depth_error.max(0.5 / N_DEPTHS as f64), n),
        recovery_us: Estimate::normal(recovery_us, recovery_error, n),
        z,
    })
}

/// Depth and time constant of the largest Poisson likelihood, the usual rate being the second
/// half's.
fn fit(counts: &[f64], bin_us: f64) -> Option<[f64; 2]> {
    let n = counts.len();
    let usual = counts[n / 2..].iter().sum::<f64>() / (n - n / 2) as f64;
    if usual <= 0.0 {
        return None;
    }
    let longest = 0.5 * bin_us * n as f64;
    let ratio = (longest / (0.5 * bin_us)).powf(1.0 / (N_TIME_CONSTANTS - 1) as f64);
    let mut best: Option<(f64, [f64; 2])> = None;
    for step in 0..N_TIME_CONSTANTS {
        let recovery_us = 0.5 * bin_us * ratio.powi(step as i32);
        let decay: Vec<f64> =
            (0..n / 2).map(|bin| (-(bin as f64 + 0.5) * bin_us / recovery_us).exp()).collect();
        for depth in (1..=N_DEPTHS).map(|i| i as f64 / N_DEPTHS as f64) {
            let pairs = counts.iter().zip(&decay);
            let likelihood: f64 = pairs
                .map(|(n, decay)| {
                    let mean = usual * (1.0 - depth * decay).max(1e-6);
                    n * mean.ln() - mean
                })
                .sum();
            if best.is_none_or(|(other, _)| likelihood > other) {
                best = Some((likelihood, [depth, recovery_us]));
            }
        }
    }
    best.map(|(_, values)| values)
}
