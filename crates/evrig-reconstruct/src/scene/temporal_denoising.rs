//! Temporal denoising of static regions.

use super::pixel_noise::PixelNoise;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Most frames before, and after, that are averaged.
const MAX_SIDE_FRAMES: usize = 8;
/// Half width of a confidence interval, in standard errors.
const INTERVAL_SIGMAS: f32 = 1.3;
/// Fewest frames of a one-sided mean; fewer may lie on a slope.
const MIN_ONE_SIDED: usize = 3;

/// Replaces each value of consecutive frames of `n_pixels` by the mean of the neighbouring frames
/// with the same intensity. Values of at least `end` are kept and excluded from every mean. The
/// window grows on either side while the confidence intervals of all its means intersect
/// (Goldenshluger and Nemirovski, 1997), which bounds the bias by the noise. Where both sides
/// differ, as on a slope, it is symmetric.
pub(super) fn denoise(values: &mut [f32], n_pixels: usize, noise: &PixelNoise, end: f32) {
    let mut before: VecDeque<Vec<f32>> = VecDeque::with_capacity(MAX_SIDE_FRAMES + 1);
    for start in (0..values.len()).step_by(n_pixels.max(1)) {
        let (own, behind) = values[start..].split_at_mut(n_pixels);
        before.truncate(MAX_SIDE_FRAMES);
        let original = own.to_vec();
        own.par_iter_mut().enumerate().filter(|(_, value)| **value < end).for_each(|(i, value)| {
            let earlier = before.iter().map(|frame| frame[i]);
            let later = behind.iter().skip(i).step_by(n_pixels).take(MAX_SIDE_FRAMES).copied();
            let interval = INTERVAL_SIGMAS * noise.at(*value);
            let is_valid = |value: &f32| *value < end;
            let sides = [
                consistent_side(*value, earlier.take_while(is_valid), interval),
                consistent_side(*value, later.take_while(is_valid), interval),
            ];
            *value = mean(*value, sides, interval);
        });
        before.push_front(original);
    }
}

/// Cumulative sums of the frames on one side, and how many are used.
#[derive(Debug, Clone, Copy, Default)]
struct OneSidedSums {
    sums: [f32; MAX_SIDE_FRAMES + 1],
    n: usize,
}

impl OneSidedSums {
    fn mean(&self) -> f32 {
        self.sums[self.n] / self.n as f32
    }
}

/// Extends one side while the intervals intersect.
fn consistent_side(first: f32, next: impl Iterator<Item = f32>, interval: f32) -> OneSidedSums {
    let (mut low, mut high) = (first - interval, first + interval);
    let mut side = OneSidedSums::default();
    for value in next {
        let sum = side.sums[side.n] + value;
        let n = side.n as f32 + 2.0;
        let (mean, half) = ((first + sum) / n, interval / n.sqrt());
        (low, high) = (low.max(mean - half), high.min(mean + half));
        if low > high {
            break;
        }
        side.n += 1;
        side.sums[side.n] = sum;
    }
    side
}

/// Mean of a value and both sides; symmetric on a slope.
fn mean(value: f32, [mut before, mut behind]: [OneSidedSums; 2], interval: f32) -> f32 {
    let (fewest, most) = (before.n.min(behind.n), before.n.max(behind.n));
    let is_slope = if fewest == 0 {
        most < MIN_ONE_SIDED
    } else {
        let error = (1.0 / before.n as f32 + 1.0 / behind.n as f32).sqrt();
        (before.mean() - behind.mean()).abs() > interval * error
    };
    if is_slope {
        (before.n, behind.n) = (fewest, fewest);
    }
    let n = 1 + before.n + behind.n;
    (value + before.sums[before.n] + behind.sums[behind.n]) / n as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::SplitMix;

    #[test]
    fn noise_goes_where_light_rests_and_steps_and_slopes_stay() {
        let mut random = SplitMix::new(8, 2);
        let (n_pixels, n_frames) = (300, 30);
        // A third each is static, steps at frame 15, falls by 2.5 standard deviations per frame.
        let light = |i: usize, frame: usize| match i % 3 {
            0 => 0.5,
            1 if frame >= 15 => 0.9,
            1 => 0.3,
            _ => 0.9 - 0.025 * frame as f32,
        };
        let truth: Vec<f32> =
            (0..n_frames).flat_map(|frame| (0..n_pixels).map(move |i| light(i, frame))).collect();
        let mut values: Vec<f32> =
            truth.iter().map(|light| light + 0.01 * random.normal() as f32).collect();
        let raw = values.clone();
        let noise = PixelNoise::estimate(&[0.5; 3], 1, 0.01);
        denoise(&mut values, n_pixels, &noise, f32::INFINITY);
        let rms = |values: &[f32], kind: usize| {
            let own = values.iter().zip(&truth).enumerate().filter(|(k, _)| k % 3 == kind);
            let (sum, n) =
                own.fold((0.0, 0.0), |(s, n), (_, (v, t))| (s + (v - t).powi(2), n + 1.0));
            (sum / n as f32).sqrt()
        };
        for (kind, most) in [(0, 0.5), (1, 0.55), (2, 1.0)] {
            let is = rms(&values, kind) / rms(&raw, kind);
            assert!(is < most, "{is} of the noise is left in kind {kind}");
        }
    }

    #[test]
    fn the_end_of_the_range_is_no_light_to_be_averaged() {
        let mut values = [0.97, 0.99, 0.98, 0.98, 1.0, 0.98, 1.0];
        let noise = PixelNoise::estimate(&[0.5; 3], 1, 0.05);
        denoise(&mut values, 1, &noise, 1.0);
        assert!((values[0] - 0.98).abs() < 1e-6, "{values:?}");
        assert_eq!([values[4], values[5], values[6]], [1.0, 0.98, 1.0]);
    }
}
