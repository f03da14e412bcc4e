//! Events of the pixels that may fire, in rounds: each draws the next event of all of them.
//!
//! A voltage known as a mean and a variance is one that started surely at mean − μ past, so
//! long ago that noise has made the variance since (variance = σ² past). It did not reach the
//! barrier ahead on the way, or that would be within reach now. So the time of the next event
//! is a single inverse Gaussian draw from there, less the past. After an event the voltage is
//! surely 0, and the next round draws from there.
//!
//! In a round nothing waits for the draw before it, so that the processor overlaps the pixels.

use super::PASS_PIXELS;
use super::voltages::VoltageMoments;
use crate::random::{CounterRng, RandomSource};
use crate::sequence::FrameSpan;
use crate::voltmeter::coefficients::{Coefficients, DriftDiffusion};
use multiversion::multiversion;

/// Exponent below which a probability counts as none (e⁻³⁵ = 6e-16).
const NEVER: f64 = 35.0;

/// Longest past, µs, that is lent to a voltage; its rounding is 1e-4 µs.
const LONGEST_PAST_US: f64 = 1e12;

/// Blocks of random words that a round keeps for each pixel: the first for the two draws of its
/// event, half of the others for a normal draw outside its layer, the rest for the interval's end.
const BLOCKS_PER_ROUND: u32 = 1 << 16;

type PixelColumn = [f64; PASS_PIXELS];

/// The pixels of one pass that may still fire, a column each for what is known of them.
#[derive(Debug)]
pub(super) struct EventRounds {
    source: RandomSource,
    interval: FrameSpan,
    /// Row-major number of the pass's first pixel.
    first: u32,
    /// Number of the round's first block of random words.
    block: u32,
    n: usize,
    /// Number in the pass.
    index: [u32; PASS_PIXELS],
    before: PixelColumn,
    after: PixelColumn,
    drift: PixelColumn,
    sigma: PixelColumn,
    /// Law of the voltage `rest` before the interval's end.
    mean: PixelColumn,
    variance: PixelColumn,
    rest: PixelColumn,
    normal: PixelColumn,
    uniform: PixelColumn,
    /// Time from then to the next event along the drift; infinite where the drift does not decide.
    time: PixelColumn,
}

/// A pixel in a round.
#[derive(Debug)]
pub(super) struct PixelRound {
    /// Number in the pass.
    pub(super) index: usize,
    pub(super) moments: VoltageMoments,
    pub(super) motion: DriftDiffusion,
    /// The normal draw behind `time_us`.
    pub(super) normal: f64,
    /// Time to the end of the interval, µs.
    pub(super) rest_us: f64,
    /// Time to the next event, µs; infinite where the drift does not decide.
    pub(super) time_us: f64,
    /// What further draws come from.
    pub(super) draws: CounterRng,
}

impl EventRounds {
    pub(super) fn new(source: RandomSource, interval: FrameSpan) -> Self {
        let zeros = [0.0; PASS_PIXELS];
        let [before, after, drift, sigma, mean, variance, rest, normal, uniform, time] =
            [zeros; 10];
        let (first, block, n, index) = (0, 0, 0, [0; PASS_PIXELS]);
        Self {
            source,
            interval,
            first,
            block,
            n,
            index,
            before,
            after,
            drift,
            sigma,
            mean,
            variance,
            rest,
            normal,
            uniform,
            time,
        }
    }

    /// Takes in the flagged pixels of a pass, whose first has the row-major number `first`.
    #[inline]
    pub(super) fn start(
        &mut self,
        first: u32,
        may_fire: &[bool],
        [before, after]: [&[f32]; 2],
        moments: impl Fn(usize) -> VoltageMoments,
        k: &Coefficients,
    ) {
        let mut n = 0;
        // Without a branch: whether a pixel may fire is hard to foresee.
        for (i, &may_fire) in may_fire.iter().enumerate() {
            self.index[n] = i as u32;
            n += usize::from(may_fire);
        }
        (self.first, self.block, self.n) = (first, 0, n);
        for i in 0..n {
            let pixel = self.index[i] as usize;
            let VoltageMoments { mean, variance } = moments(pixel);
            (self.mean[i], self.variance[i]) = (mean, variance);
            self.before[i] = f64::from(before[pixel]);
            self.after[i] = f64::from(after[pixel]);
        }
        set_motion(self, k);
    }

    /// Whole registers of pixels; what lies beyond `n` in the last is not read.
    fn n_padded(&self) -> usize {
        self.n.next_multiple_of(8)
    }

    /// Draws the time of each pixel's next event, if any pixel is left.
    #[inline]
    pub(super) fn draw(&mut self) -> bool {
        for i in 0..self.n {
            let pixel = self.first + self.index[i];
            let mut draws = self.source.draws_from(pixel, self.interval.index, self.block);
            (self.normal[i], self.uniform[i]) = (draws.normal(), draws.uniform());
        }
        set_times(self);
        self.n > 0
    }

    /// Passes every pixel to `step`. Those for which it returns a rest
    /// fired so long before the interval's end and go on to the next round.
    #[inline]
    pub(super) fn retain(&mut self, mut step: impl FnMut(PixelRound) -> Option<f64>) {
        let mut n = 0;
        for i in 0..self.n {
            let Some(rest_us) = step(self.at(i)) else { continue };
            self.index[n] = self.index[i];
            self.drift[n] = self.drift[i];
            self.sigma[n] = self.sigma[i];
            self.rest[n] = rest_us;
            n += 1;
        }
        self.mean[..n].fill(0.0);
        self.variance[..n].fill(0.0);
        self.n = n;
        self.block = self.block.wrapping_add(BLOCKS_PER_ROUND);
    }

    #[inline]
    fn at(&self, i: usize) -> PixelRound {
        let (pixel, block) = (self.first + self.index[i], self.block + BLOCKS_PER_ROUND / 2);
        PixelRound {
            draws: self.source.draws_from(pixel, self.interval.index, block),
            index: self.index[i] as usize,
            moments: VoltageMoments { mean: self.mean[i], variance: self.variance[i] },
            motion: DriftDiffusion {
                drift_per_us: self.drift[i],
                sigma_per_sqrt_us: self.sigma[i],
            },
            normal: self.normal[i],
            rest_us: self.rest[i],
            time_us: self.time[i],
        }
    }
}

/// Motion of the pixels taken in.
#[multiversion(targets("x86_64+avx2"))]
fn set_motion(pixels: &mut EventRounds, k: &Coefficients) {
    let [k1, k2, k3, k4, k5, k6] = k.k();
    let n = pixels.n_padded();
    let span = f64::from(pixels.interval.span_us);
    let per_span = 1.0 / span;
    let (before, after) = (&pixels.before[..n], &pixels.after[..n]);
    let (drift, sigma) = (&mut pixels.drift[..n], &mut pixels.sigma[..n]);
    for i in 0..n {
        let middle = 0.5 * (before[i] + after[i]);
        let gain = 1.0 / (middle + k2);
        drift[i] = k1 * gain * (after[i] - before[i]) * per_span + k4 + k5 * middle;
        sigma[i] = k3 * gain * middle.sqrt() + k6;
    }
    pixels.rest[..n].fill(span);
}

/// Time to the barrier ahead with nothing behind: inverse Gaussian of mean distance/drift and
/// shape (distance/sigma)², drawn as in [`crate::voltmeter::passage::crossing_share`].
#[multiversion(targets("x86_64+avx2"))]
fn set_times(pixels: &mut EventRounds) {
    let n = pixels.n_padded();
    let (drift, sigma) = (&pixels.drift[..n], &pixels.sigma[..n]);
    let (mean, variance) = (&pixels.mean[..n], &pixels.variance[..n]);
    let (normal, uniform) = (&pixels.normal[..n], &pixels.uniform[..n]);
    let time = &mut pixels.time[..n];
    for i in 0..n {
        let rate = sigma[i] * sigma[i];
        let speed = drift[i].abs();
        let towards = if drift[i] > 0.0 { mean[i] } else { -mean[i] };
        // Without variance there is no past, also where there is no noise (0/0).
        let past = variance[i] / rate;
        let past = if variance[i] > 0.0 { past } else { 0.0 };
        let per_distance = 1.0 / (1.0 - towards + speed * past);
        let delta = speed * per_distance;
        let scaled = sigma[i] * normal[i] * per_distance;
        let r = 0.5 * scaled * scaled;
        let w = delta + r + (r * (r + 2.0 * delta)).sqrt();
        // The roots are 1/w and w/δ².
        let is_small = uniform[i] * (w + delta) <= w;
        let above = if is_small { 1.0 } else { w };
        let below = if is_small { w } else { delta * delta };
        let after = above / below - past;
        // Drift decides if the mean keeps clear of the barrier behind by 8 standard
        // deviations. Then the chance to be hit there is largest for a voltage halfway, where
        // it is exp(-b (1 + mean)).
        let is_clear = speed * (1.0 + towards) > NEVER * rate;
        let is_driven = is_clear & (variance[i] <= LONGEST_PAST_US * rate);
        time[i] = if is_driven { after } else { f64::INFINITY };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A draw of the inverse Gaussian by the larger root of Michael, Schucany and Haas as they
    /// write it, from the same normal and uniform number.
    fn inverse_gaussian(mean: f64, shape: f64, normal: f64, uniform: f64) -> f64 {
        let y = normal * normal;
        let root = (4.0 * mean * shape * y + (mean * y).powi(2)).sqrt();
        let larger = mean + 0.5 * mean / shape * (mean * y + root);
        let smaller = mean * mean / larger;
        if uniform <= mean / (mean + smaller) { smaller } else { larger }
    }

    #[test]
    fn pixels_in_lanes_get_the_motion_and_time_that_one_alone_gets() {
        let k = Coefficients::RAW2DVS346;
        let (source, span_us) = (RandomSource::new(5), 8_333);
        let interval = FrameSpan { index: 3, start_us: 0, span_us, brightest: 1e3 };
        let (before, after): (Vec<f32>, Vec<f32>) =
            (0..51).map(|i| i as f32).map(|i| (100.0 + i, 400.0 - 7.0 * i)).unzip();
        // Every third pixel is not taken in; the others have come a part of the way, some of them
        // with noise that was not drawn.
        let may_fire: Vec<bool> = (0..51).map(|i| i % 3 > 0).collect();
        let moments = |i: usize| VoltageMoments {
            mean: 0.01 * i as f64,
            variance: if i.is_multiple_of(2) { 0.0 } else { 1e-6 },
        };
        let mut rounds = EventRounds::new(source, interval);
        rounds.start(700, &may_fire, [&before, &after], moments, &k);
        assert!(rounds.draw());
        let mut n_seen = 0;
        rounds.retain(|pixel| {
            let i = pixel.index;
            assert!(may_fire[i] && pixel.moments == moments(i));
            let exact = k.motion(before[i], after[i], f64::from(span_us));
            let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-9;
            assert!(close(pixel.motion.drift_per_us, exact.drift_per_us));
            assert!(close(pixel.motion.sigma_per_sqrt_us, exact.sigma_per_sqrt_us));
            let past_us = pixel.moments.variance / exact.sigma_per_sqrt_us.powi(2);
            let drift = exact.drift_per_us.abs();
            let towards = pixel.moments.mean * exact.drift_per_us.signum();
            let distance = 1.0 - towards + drift * past_us;
            let mut draws = source.draws(700 + i as u32, 3);
            let (normal, uniform) = (draws.normal(), draws.uniform());
            let shape = (distance / exact.sigma_per_sqrt_us).powi(2);
            let alone = inverse_gaussian(distance / drift, shape, normal, uniform) - past_us;
            assert!((pixel.time_us - alone).abs() < 1e-6 * alone.abs(), "{i}: {alone}");
            n_seen += 1;
            None
        });
        assert_eq!(n_seen, 34);
        assert!(!rounds.draw(), "no pixel goes on");
    }
}
