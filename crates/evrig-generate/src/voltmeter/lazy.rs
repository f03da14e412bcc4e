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
mod rounds;
mod voltages;

use drift::IntervalCoefficients;
use rounds::{EventRounds, PixelRound};
use voltages::VoltageMoments;
pub(crate) use voltages::Voltages;

/// Pixels of a pass: what stays in the nearest cache while it is worked on.
const PASS_PIXELS: usize = 256;

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
        let moves = IntervalCoefficients::new(&self.k, interval.span_us);
        let mut may_fire = [false; PASS_PIXELS];
        let mut rounds = EventRounds::new(self.source, interval);
        for start in (0..after.len()).step_by(PASS_PIXELS) {
            let pass = start..after.len().min(start + PASS_PIXELS);
            let (before, after) = (&before[pass.clone()], &after[pass.clone()]);
            let may_fire = &mut may_fire[..pass.len()];
            moves.let_drift(before, after, state.columns(pass), may_fire);
            let first = *first + start as u32;
            let moments = |i| state.moments(start + i);
            rounds.start(first, may_fire, [before, after], moments, &self.k);
            while rounds.draw() {
                rounds.retain(|pixel| {
                    let index = pixel.index;
                    let number = first + index as u32;
                    let fire = |offset_us, on| {
                        hits.push(Crossing::new(number, offset_us, interval.span_us, on));
                    };
                    match advance(pixel, f64::from(interval.span_us), fire) {
                        RoundEnd::Silent(moments) => {
                            state.set(start + index, moments);
                            None
                        }
                        RoundEnd::Fired { rest_us } => Some(rest_us),
                    }
                });
            }
        }
    }
}

/// How a round ends for a pixel.
enum RoundEnd {
    /// No further event: the law of the voltage at the interval's end.
    Silent(VoltageMoments),
    /// It may fire again within so much of the interval.
    Fired { rest_us: f64 },
}

/// Moves a pixel to its next event, or to the interval's end if no barrier is within reach or hit
/// before; `fire` takes times after the start of the interval.
#[inline]
fn advance(pixel: PixelRound, span_us: f64, mut fire: impl FnMut(f64, bool)) -> RoundEnd {
    let PixelRound { motion, rest_us, time_us, .. } = pixel;
    if time_us >= rest_us {
        return RoundEnd::Silent(last_stretch(pixel, span_us, &mut fire));
    }
    let rest_us = rest_us - time_us.max(0.0);
    fire(span_us - rest_us, motion.drift_per_us > 0.0);
    let mean = motion.drift_per_us * rest_us;
    let variance = motion.sigma_per_sqrt_us * motion.sigma_per_sqrt_us * rest_us;
    let distance = 1.0 - mean.abs();
    if distance > 0.0 && REACH * REACH * variance < distance * distance {
        return RoundEnd::Silent(VoltageMoments { mean, variance });
    }
    RoundEnd::Fired { rest_us }
}

/// Moves a pixel to the interval's end: past the barrier ahead if drift decides, or else like any
/// other.
#[inline(never)]
fn last_stretch(
    mut pixel: PixelRound,
    span_us: f64,
    fire: &mut dyn FnMut(f64, bool),
) -> VoltageMoments {
    let VoltageMoments { mean, variance } = pixel.moments;
    let PixelRound { motion, rest_us, ref mut draws, .. } = pixel;
    if pixel.time_us.is_infinite() {
        let v = (mean + variance.sqrt() * pixel.normal).clamp(-INSIDE, INSIDE);
        let start_us = span_us - rest_us;
        let mut fire = |t, on| fire(start_us + t, on);
        let end = passage::advance(v, motion, rest_us, draws, &mut fire);
        return VoltageMoments { mean: end, variance: 0.0 };
    }
    let (drift, side) = (motion.drift_per_us.abs(), motion.drift_per_us.signum());
    let rate = motion.sigma_per_sqrt_us * motion.sigma_per_sqrt_us;
    let past_us = if variance > 0.0 { variance / rate } else { 0.0 };
    let start = side * mean - drift * past_us;
    let end = start + move_below(1.0 - start, drift, rate, past_us + rest_us, draws);
    VoltageMoments { mean: side * end.clamp(-INSIDE, INSIDE), variance: 0.0 }
}

/// A move over `span_us` along the drift given that it never reached `distance`.
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
