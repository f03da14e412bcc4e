//! The event model, fast: noise is drawn only when a pixel may fire.
//!
//! As long as no barrier is within reach, V is Gaussian; its mean and variance are kept
//! instead of V, and an interval adds to both: no random number is needed for most pixels of
//! most frames, and the loop over them runs in wide registers. Where a barrier comes
//! within reach, V is drawn and the pixel is moved through the interval like any other.
//! A barrier counts as out of reach when it is 8 standard deviations away from the mean at
//! both ends of the interval, as in [`super::passage`]: the neglected mass is below 2.5e-14.

use super::passage::{INSIDE, REACH};
use super::{Coefficients, Motion, passage};
use crate::generate::grid::{Block, PixelModel};
use crate::generate::merge::Hit;
use crate::generate::random::{Draws, Source};
use crate::generate::sequence::Interval;

/// The event model with lazily drawn noise.
#[derive(Debug)]
pub(in crate::generate) struct LazyVoltmeter {
    k: Coefficients,
    source: Source,
}

/// The law of each pixel's voltage: normal with this mean and variance.
#[derive(Debug)]
pub(in crate::generate) struct Voltages {
    /// f64, so that many small moves add up without drift.
    mean: Vec<f64>,
    /// Grows from 0 after each draw; f32 keeps it to n frames times 6e-8.
    variance: Vec<f32>,
}

#[cfg(test)]
impl Voltages {
    pub(super) fn means(&self) -> &[f64] {
        &self.mean
    }

    pub(super) fn variances(&self) -> &[f32] {
        &self.variance
    }
}

/// A voltage of which so much is known.
#[derive(Debug, Clone, Copy)]
struct Belief {
    mean: f64,
    variance: f64,
}

/// Pixels of one pass of the wide loop, as many as flags fit a word.
const LANES: usize = 64;

impl LazyVoltmeter {
    pub(in crate::generate) fn new(k: Coefficients, seed: u64) -> Self {
        Self { k, source: Source::new(seed) }
    }

    /// A pixel that may fire: draws its voltage and moves it through the interval.
    fn fire(
        &self,
        pixel: u32,
        belief: Belief,
        motion: Motion,
        interval: Interval,
        hits: &mut Vec<Hit>,
    ) -> Belief {
        let mut draws = self.source.draws(pixel, interval.index);
        let v = belief.mean + belief.variance.sqrt() * draws.normal();
        let v = v.clamp(-INSIDE, INSIDE);
        advance(v, motion, f64::from(interval.span_us), &mut draws, |t, on| {
            hits.push(Hit::new(pixel, t, interval.span_us, on));
        })
    }
}

impl PixelModel for LazyVoltmeter {
    const NAME: &'static str = "voltmeter";

    type State = Voltages;

    fn most_events(&self, interval: Interval) -> f64 {
        self.k.most_events(interval)
    }

    fn start(&self, _first: u32, brightness: &[f32]) -> Voltages {
        let n = brightness.len();
        Voltages { mean: vec![0.0; n], variance: vec![0.0; n] }
    }

    fn run(&self, block: &mut Block<Voltages>, after: &[f32], interval: Interval) {
        let span_us = f64::from(interval.span_us);
        let moves = Moves::new(&self.k, interval.span_us);
        let Voltages { mean, variance } = &mut block.state;
        for start in (0..after.len()).step_by(LANES) {
            let part = start..after.len().min(start + LANES);
            let (before, after) = (&block.before[part.clone()], &after[part.clone()]);
            let (mean, variance) = (&mut mean[part.clone()], &mut variance[part]);
            let mut reachable = moves.let_drift(before, after, mean, variance);
            while reachable != 0 {
                let i = reachable.trailing_zeros() as usize;
                reachable &= reachable - 1;
                let belief = Belief { mean: mean[i], variance: f64::from(variance[i]) };
                let motion = self.k.motion(before[i], after[i], span_us);
                let pixel = block.first + (start + i) as u32;
                let belief = self.fire(pixel, belief, motion, interval, &mut block.hits);
                mean[i] = belief.mean;
                variance[i] = belief.variance as f32;
            }
        }
    }
}

/// What an interval does to mean and variance, in f32: a relative error of 3e-7 in drift
/// and diffusion, for twice as many pixels a register.
#[derive(Debug, Clone, Copy)]
struct Moves {
    k1: f32,
    k2: f32,
    k3: f32,
    k6: f32,
    /// k4 and k5 times the span.
    leak: f32,
    bright_leak: f32,
    span_us: f32,
}

impl Moves {
    fn new(k: &Coefficients, span_us: u32) -> Self {
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

    /// Moves the pixels that cannot fire and returns a bit for each that may.
    fn let_drift(
        &self,
        before: &[f32],
        after: &[f32],
        mean: &mut [f64],
        variance: &mut [f32],
    ) -> u64 {
        let n = before.len().min(LANES);
        let (before, after) = (&before[..n], &after[..n]);
        let (mean, variance) = (&mut mean[..n], &mut variance[..n]);
        let mut flags = [0_u8; LANES];
        for i in 0..n {
            let middle = 0.5 * before[i] + 0.5 * after[i];
            let gain = 1.0 / (middle + self.k2);
            let drift =
                self.k1 * gain * (after[i] - before[i]) + (self.leak + self.bright_leak * middle);
            let sigma = self.k3 * gain * middle.sqrt() + self.k6;
            let end = mean[i] + f64::from(drift);
            let spread = variance[i] + sigma * sigma * self.span_us;
            let room = 1.0 - mean[i].abs().max(end.abs()) as f32;
            let is_free = room > 0.0 && (REACH * REACH) as f32 * spread < room * room;
            mean[i] = if is_free { end } else { mean[i] };
            variance[i] = if is_free { spread } else { variance[i] };
            flags[i] = u8::from(!is_free);
        }
        flags.iter().enumerate().fold(0, |bits, (i, &flag)| bits | u64::from(flag) << i)
    }
}

/// Exponent below which a probability counts as none (e⁻³⁵ = 6e-16).
const NEVER: f64 = 35.0;

/// Moves `v` through an interval; like [`passage::advance`], with less drawn where
/// drift dominates, and the end left undrawn when it is free.
fn advance(
    mut v: f64,
    motion: Motion,
    span_us: f64,
    draws: &mut Draws,
    mut fire: impl FnMut(f64, bool),
) -> Belief {
    let Motion { drift_per_us: drift, sigma_per_sqrt_us: sigma } = motion;
    let rate = sigma * sigma;
    let towards = drift > 0.0;
    let mut elapsed = 0.0;
    loop {
        let rest = span_us - elapsed;
        let belief = Belief { mean: v + drift * rest, variance: rate * rest };
        let room = 1.0 - v.abs().max(belief.mean.abs());
        if room > 0.0 && REACH * REACH * belief.variance < room * room {
            return belief;
        }
        let (ahead, behind) = if towards { (1.0 - v, 1.0 + v) } else { (1.0 + v, 1.0 - v) };
        if 2.0 * drift.abs() * behind <= NEVER * rate {
            // The barrier behind may be hit: the general way.
            let end = passage::advance(v, motion, rest, draws, &mut |t, on| fire(elapsed + t, on));
            return Belief { mean: end, variance: 0.0 };
        }
        let after = time_along(ahead, drift.abs(), sigma, draws);
        if after >= rest {
            let by = move_below(ahead, drift.abs() * rest, sigma * rest.sqrt(), draws);
            let end = v + if towards { by } else { -by };
            return Belief { mean: end.clamp(-INSIDE, INSIDE), variance: 0.0 };
        }
        elapsed += after;
        fire(elapsed, towards);
        v = 0.0;
    }
}

/// Time to `distance` along the drift with nothing behind: inverse Gaussian of mean
/// distance/drift and shape (distance/sigma)², drawn as in [`passage::crossing_share`].
#[inline]
fn time_along(distance: f64, drift: f64, sigma: f64, draws: &mut Draws) -> f64 {
    let delta = drift / distance;
    let scaled = sigma * draws.normal() / distance;
    let r = 0.5 * scaled * scaled;
    let w = delta + r + (r * (r + 2.0 * delta)).sqrt();
    // The roots are 1/w and w/δ²; a choice of numbers, not of ways, costs no misprediction.
    let is_small = draws.uniform() * (w + delta) <= w;
    let above = if is_small { 1.0 } else { w };
    let below = if is_small { w } else { delta * delta };
    above / below
}

/// A move over a whole interval given that it never reached `distance`.
fn move_below(distance: f64, mean: f64, sd: f64, draws: &mut Draws) -> f64 {
    if sd < 1e-9 * distance {
        // No noise to speak of: rounding alone may put the end past the barrier.
        return mean.min(distance);
    }
    loop {
        let end = mean + sd * draws.normal();
        let exponent = 2.0 * distance * (distance - end) / (sd * sd);
        if end < distance && draws.uniform() < -(-exponent).exp_m1() {
            return end;
        }
    }
}
