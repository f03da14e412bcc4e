//! The event model, fast: noise is drawn only when a pixel may fire.
//!
//! As long as no barrier is within reach, V is Gaussian; its mean and variance are kept
//! instead of V, and an interval adds to both: no random number is needed for most pixels of
//! most frames, and the loop over them runs in wide registers. Where a barrier comes
//! within reach, V is drawn and the pixel is moved through the interval like any other.
//! A barrier counts as out of reach when it is 8 standard deviations away from the mean at
//! both ends of the interval, as in [`super::passage`]: the neglected mass is below 2.5e-14.

use super::coefficients::Coefficients;
use super::passage::{self, INSIDE, REACH};
use crate::grid::{FramePixelModel, PixelBlock};
use crate::merge::Crossing;
use crate::random::{CounterRng, RandomSource};
use crate::sequence::FrameSpan;

mod drift;
mod first;
mod voltages;

use drift::{IntervalCoefficients, LANES};
use first::{FirstEvent, FirstEvents, time_along_one};
use voltages::VoltageMoments;
pub(crate) use voltages::Voltages;

/// The event model with lazily drawn noise.
#[derive(Debug)]
pub(crate) struct LazyVoltmeter {
    k: Coefficients,
    source: RandomSource,
}

impl LazyVoltmeter {
    pub(crate) fn new(k: Coefficients, seed: u64) -> Self {
        Self { k, source: RandomSource::new(seed) }
    }
}

impl FramePixelModel for LazyVoltmeter {
    const NAME: &'static str = "voltmeter";

    type State = Voltages;

    fn max_mean_events(&self, interval: FrameSpan) -> f64 {
        self.k.max_mean_events(interval)
    }

    fn start(&self, _first: u32, brightness: &[f32]) -> Voltages {
        let zeros = vec![0.0; brightness.len()];
        Voltages { mean: zeros.clone(), excess: zeros.clone(), variance: zeros }
    }

    fn restart(&self, block: &mut PixelBlock<Voltages>, i: usize) {
        block.state.set(i, VoltageMoments { mean: 0.0, variance: 0.0 });
    }

    fn run(&self, block: &mut PixelBlock<Voltages>, after: &[f32], interval: FrameSpan) {
        let PixelBlock { first, before, hits, state } = block;
        let span_us = f64::from(interval.span_us);
        let moves = IntervalCoefficients::new(&self.k, interval.span_us);
        let mut firsts = FirstEvents::new();
        for start in (0..after.len()).step_by(LANES) {
            let lanes = start..after.len().min(start + LANES);
            let (before, after) = (&before[lanes.clone()], &after[lanes.clone()]);
            let mut flags = moves.let_drift(before, after, state.columns(lanes));
            // First what does not branch, so that the processor overlaps the pixels.
            firsts.clear();
            while flags != 0 {
                let lane = flags.trailing_zeros() as usize;
                flags &= flags - 1;
                let pixel = *first + (start + lane) as u32;
                let moments = state.moments(start + lane);
                firsts.push(pixel, [before[lane], after[lane]], moments, self.source, interval);
            }
            firsts.draw(&self.k, span_us);
            for i in 0..firsts.len() {
                let first_event = firsts.at(i);
                let pixel = first_event.pixel;
                let end = advance(first_event, span_us, |t, on| {
                    hits.push(Crossing::new(pixel, t, interval.span_us, on));
                });
                state.set((pixel - *first) as usize, end);
            }
        }
    }
}

/// Exponent below which a probability counts as none (e⁻³⁵ = 6e-16).
const NEVER: f64 = 35.0;

/// Longest past, µs, that is lent to a voltage; its rounding is 1e-4 µs.
const LONGEST_PAST_US: f64 = 1e12;

/// Moves a voltage through an interval; like [`passage::advance`], with less drawn where
/// drift dominates, and the end left undrawn when no barrier is within reach of it.
#[inline]
fn advance(first: FirstEvent<'_>, span_us: f64, mut fire: impl FnMut(f64, bool)) -> VoltageMoments {
    let FirstEvent { mut moments, motion, draws, normal, mut past_us, mut time_us, .. } = first;
    let (drift, on) = (motion.drift_per_us.abs(), motion.drift_per_us > 0.0);
    let rate = motion.sigma_per_sqrt_us * motion.sigma_per_sqrt_us;
    let mut elapsed = 0.0;
    let mut towards = if on { moments.mean } else { -moments.mean };
    // The mean keeps clear of the barrier behind by 8 standard deviations. Then the chance to
    // be hit there is largest for a voltage halfway, where it is exp(-b (1 + mean)).
    if drift * (1.0 + towards) <= NEVER * rate || moments.variance > LONGEST_PAST_US * rate {
        let v = (moments.mean + moments.variance.sqrt() * normal).clamp(-INSIDE, INSIDE);
        let end = passage::advance(v, motion, span_us, draws, &mut fire);
        return VoltageMoments { mean: end, variance: 0.0 };
    }
    loop {
        let rest = span_us - elapsed;
        if time_us >= rest {
            let start = towards - drift * past_us;
            let by = move_below(1.0 - start, drift, rate, past_us + rest, draws);
            let end = if on { start + by } else { -(start + by) };
            return VoltageMoments { mean: end.clamp(-INSIDE, INSIDE), variance: 0.0 };
        }
        elapsed += time_us.max(0.0);
        fire(elapsed, on);
        moments = VoltageMoments {
            mean: motion.drift_per_us * (span_us - elapsed),
            variance: rate * (span_us - elapsed),
        };
        let distance = 1.0 - moments.mean.abs();
        if distance > 0.0 && REACH * REACH * moments.variance < distance * distance {
            return moments;
        }
        if drift <= NEVER * rate {
            let rest = span_us - elapsed;
            let end =
                passage::advance(0.0, motion, rest, draws, &mut |t, on| fire(elapsed + t, on));
            return VoltageMoments { mean: end, variance: 0.0 };
        }
        (towards, past_us) = (0.0, 0.0);
        time_us = time_along_one(1.0, motion, draws);
    }
}

/// A move over `span_us` along the drift given that it never reached `distance`.
#[inline(never)]
fn move_below(distance: f64, drift: f64, rate: f64, span_us: f64, draws: &mut CounterRng) -> f64 {
    let (mean, variance) = (drift * span_us, rate * span_us);
    let sd = variance.sqrt();
    if sd < 1e-9 * distance {
        // No noise to speak of: rounding alone may put the end past the barrier.
        return mean.min(distance);
    }
    loop {
        let end = mean + sd * draws.normal();
        let exponent = 2.0 * distance * (distance - end) / variance;
        if end < distance && (exponent > 40.0 || draws.uniform() < -(-exponent).exp_m1()) {
            return end;
        }
    }
}
