//! The first event of the pixels that may fire: motion and time of several pixels at once.
//!
//! A voltage known as a mean and a variance is one that started surely at mean − μ past, so
//! long ago that noise has made the variance since (variance = σ² past). It did not reach the
//! barrier ahead on the way, or that would be within reach now. So the time of the first event
//! is a single inverse Gaussian draw from there, less the past.

use super::drift::LANES;
use super::voltages::VoltageMoments;
use crate::random::{CounterRng, RandomSource};
use crate::sequence::FrameSpan;
use crate::voltmeter::coefficients::{Coefficients, DriftDiffusion};
use std::hint::select_unpredictable;
use wide::f64x4;

/// Pixels of a register.
const FOUR: usize = 4;

type LaneColumn = [f64; LANES];

/// The pixels of one pass that may fire, a column each for what is known of them.
#[derive(Debug)]
pub(super) struct FirstEvents {
    n: usize,
    pixel: [u32; LANES],
    draws: Vec<CounterRng>,
    before: LaneColumn,
    after: LaneColumn,
    mean: LaneColumn,
    variance: LaneColumn,
    normal: LaneColumn,
    uniform: LaneColumn,
    drift: LaneColumn,
    sigma: LaneColumn,
    past: LaneColumn,
    time: LaneColumn,
}

/// A pixel that may fire.
#[derive(Debug)]
pub(super) struct FirstEvent<'a> {
    /// Row-major number of the pixel.
    pub(super) pixel: u32,
    pub(super) moments: VoltageMoments,
    pub(super) motion: DriftDiffusion,
    /// What further draws come from.
    pub(super) draws: &'a mut CounterRng,
    /// The normal draw behind `time_us`.
    pub(super) normal: f64,
    /// How long ago the voltage was certain, µs.
    pub(super) past_us: f64,
    /// When the barrier ahead is hit if nothing is behind, µs after the interval's start.
    pub(super) time_us: f64,
}

impl FirstEvents {
    pub(super) fn new() -> Self {
        let [before, after, mean, variance, normal, uniform, drift, sigma, past, time] =
            [[0.0; LANES]; 10];
        let (n, pixel, draws) = (0, [0; LANES], Vec::with_capacity(LANES));
        Self {
            n,
            pixel,
            draws,
            before,
            after,
            mean,
            variance,
            normal,
            uniform,
            drift,
            sigma,
            past,
            time,
        }
    }

    pub(super) fn clear(&mut self) {
        self.n = 0;
        self.draws.clear();
    }

    /// Notes a pixel, with the two draws that its first event takes.
    #[inline]
    pub(super) fn push(
        &mut self,
        pixel: u32,
        brightness: [f32; 2],
        moments: VoltageMoments,
        source: RandomSource,
        interval: FrameSpan,
    ) {
        let i = self.n;
        let mut draws = source.draws(pixel, interval.index);
        self.pixel[i] = pixel;
        [self.before[i], self.after[i]] = brightness.map(f64::from);
        (self.mean[i], self.variance[i]) = (moments.mean, moments.variance);
        (self.normal[i], self.uniform[i]) = (draws.normal(), draws.uniform());
        self.draws.push(draws);
        self.n += 1;
    }

    /// Draws motion and time of all pixels noted.
    pub(super) fn draw(&mut self, k: &Coefficients, span_us: f64) {
        for start in (0..self.n).step_by(FOUR) {
            self.draw_four(start / FOUR, k, 1.0 / span_us);
        }
    }

    #[inline]
    fn draw_four(&mut self, four: usize, k: &Coefficients, per_span: f64) {
        let [k1, k2, k3, k4, k5, k6] = k.k().map(f64x4::splat);
        let read = |column: &LaneColumn| f64x4::from(column.as_chunks::<FOUR>().0[four]);
        let (before, after) = (read(&self.before), read(&self.after));
        let middle = f64x4::splat(0.5) * (before + after);
        let gain = f64x4::ONE / (middle + k2);
        let drift = k1 * gain * (after - before) * f64x4::splat(per_span) + k4 + k5 * middle;
        let sigma = k3 * gain * middle.sqrt() + k6;
        let (mean, variance) = (read(&self.mean), read(&self.variance));
        // Without variance there is no past, also where there is no noise (0/0).
        let past = variance.simd_gt(f64x4::ZERO).select(variance / (sigma * sigma), f64x4::ZERO);
        let towards = drift.simd_gt(f64x4::ZERO).select(mean, -mean);
        let speed = drift.abs();
        let distance = f64x4::ONE - towards + speed * past;
        let time = time_along(distance, speed, sigma, read(&self.normal), read(&self.uniform));
        let write = |column: &mut LaneColumn, value: f64x4| {
            column.as_chunks_mut::<FOUR>().0[four] = value.to_array();
        };
        write(&mut self.drift, drift);
        write(&mut self.sigma, sigma);
        write(&mut self.past, past);
        write(&mut self.time, time - past);
    }

    /// How many pixels are noted.
    pub(super) fn len(&self) -> usize {
        self.n
    }

    /// Pixel number `i` of those noted.
    #[inline]
    pub(super) fn at(&mut self, i: usize) -> FirstEvent<'_> {
        FirstEvent {
            pixel: self.pixel[i],
            moments: VoltageMoments { mean: self.mean[i], variance: self.variance[i] },
            motion: DriftDiffusion {
                drift_per_us: self.drift[i],
                sigma_per_sqrt_us: self.sigma[i],
            },
            draws: &mut self.draws[i],
            normal: self.normal[i],
            past_us: self.past[i],
            time_us: self.time[i],
        }
    }
}

/// Time to `distance` along the drift with nothing behind: inverse Gaussian of mean
/// distance/drift and shape (distance/sigma)², drawn as in
/// [`crate::voltmeter::passage::crossing_share`].
#[inline]
fn time_along(distance: f64x4, drift: f64x4, sigma: f64x4, normal: f64x4, uniform: f64x4) -> f64x4 {
    let per_distance = f64x4::ONE / distance;
    let delta = drift * per_distance;
    let scaled = sigma * normal * per_distance;
    let r = f64x4::splat(0.5) * scaled * scaled;
    let w = delta + r + (r * (r + delta + delta)).sqrt();
    // The roots are 1/w and w/δ².
    let is_small = (uniform * (w + delta)).simd_le(w);
    is_small.select(f64x4::ONE, w) / is_small.select(w, delta * delta)
}

/// The same for one pixel.
#[inline]
pub(super) fn time_along_one(distance: f64, motion: DriftDiffusion, draws: &mut CounterRng) -> f64 {
    let (drift, sigma) = (motion.drift_per_us.abs(), motion.sigma_per_sqrt_us);
    let per_distance = 1.0 / distance;
    let delta = drift * per_distance;
    let scaled = sigma * draws.normal() * per_distance;
    let r = 0.5 * scaled * scaled;
    let w = delta + r + (r * (r + 2.0 * delta)).sqrt();
    // A choice of numbers, not of ways: it costs no misprediction.
    let is_small = draws.uniform() * (w + delta) <= w;
    select_unpredictable(is_small, 1.0, w) / select_unpredictable(is_small, w, delta * delta)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_pixels_at_once_get_the_motion_and_time_that_one_alone_gets() {
        let k = Coefficients::RAW2DVS346;
        let (source, span_us) = (RandomSource::new(5), 8_333.0);
        let interval = FrameSpan { index: 3, start_us: 0, span_us: 8_333, brightest: 1e3 };
        let mut first = FirstEvents::new();
        let brightness = |i: u32| [100.0 + i as f32, 400.0 - 7.0 * i as f32];
        for i in 0..50 {
            let moments = VoltageMoments { mean: 0.01 * f64::from(i), variance: 0.0 };
            first.push(i, brightness(i), moments, source, interval);
        }
        first.draw(&k, span_us);
        for i in 0..50 {
            let [before, after] = brightness(i);
            let exact = k.motion(before, after, span_us);
            let found = first.at(i as usize);
            let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
            assert!(close(found.motion.drift_per_us, exact.drift_per_us));
            assert!(close(found.motion.sigma_per_sqrt_us, exact.sigma_per_sqrt_us));
            let towards = found.moments.mean * exact.drift_per_us.signum();
            let alone = time_along_one(1.0 - towards, exact, &mut source.draws(i, 3));
            assert!(close(found.time_us, alone), "{} {alone}", found.time_us);
        }
    }
}
