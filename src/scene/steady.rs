//! Frames without the part of their noise that time tells: where nothing changes, neighbouring frames are
//! looks at one light.

use super::frame_noise::FrameNoise;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Frames before, and behind, that are taken together with one at most.
const WINDOW: usize = 8;

/// Half the width of a mean's interval, in its standard errors.
const INTERVAL: f32 = 2.0;

/// Puts for each value of frames of `n_pixels`, one behind the other, the mean of the frames about it that
/// show the same light; values from `end` on are left as they are, and out of every mean. To either side a
/// frame is taken as long as the intervals of all means so far have a light in common (the intersection of
/// confidence intervals; Goldenshluger and Nemirovski, 1997), so that a mean is off by what changed no more
/// than by its noise.
pub(super) fn steady(values: &mut [f32], n_pixels: usize, noise: &FrameNoise, end: f32) {
    let mut before: VecDeque<Vec<f32>> = VecDeque::with_capacity(WINDOW + 1);
    for start in (0..values.len()).step_by(n_pixels) {
        let (own, behind) = values[start..].split_at_mut(n_pixels);
        before.truncate(WINDOW);
        let seen = own.to_vec();
        own.par_iter_mut().enumerate().filter(|(_, value)| **value < end).for_each(|(i, value)| {
            let earlier = before.iter().map(|frame| frame[i]);
            let later = behind.iter().skip(i).step_by(n_pixels).take(WINDOW).copied();
            let interval = INTERVAL * noise.at(*value);
            let [before, behind] = [
                alike(*value, earlier.take_while(|look| *look < end), interval),
                alike(*value, later.take_while(|look| *look < end), interval),
            ];
            *value = (*value + before.0 + behind.0) / (1.0 + before.1 + behind.1);
        });
        before.push_front(seen);
    }
}

/// The sum and the number of the next looks that show the light of the first.
fn alike(first: f32, next: impl Iterator<Item = f32>, interval: f32) -> (f32, f32) {
    let (mut low, mut high) = (first - interval, first + interval);
    let (mut sum, mut n) = (first, 1.0_f32);
    for look in next {
        let (mean, half) = ((sum + look) / (n + 1.0), interval / (n + 1.0).sqrt());
        (low, high) = (low.max(mean - half), high.min(mean + half));
        if low > high {
            break;
        }
        (sum, n) = (sum + look, n + 1.0);
    }
    (sum - first, n - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SplitMix;

    #[test]
    fn noise_goes_where_light_rests_and_steps_and_slopes_stay() {
        let mut random = SplitMix::new(8, 2);
        let (n_pixels, n_frames) = (300, 30);
        // A third each rests, jumps at frame 15, and falls evenly and fast.
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
        let noise = FrameNoise::of(&[0.5; 3], 1, 0.01);
        steady(&mut values, n_pixels, &noise, f32::INFINITY);
        let rms = |values: &[f32], kind: usize| {
            let own = values.iter().zip(&truth).enumerate().filter(|(k, _)| k % 3 == kind);
            let (sum, n) =
                own.fold((0.0, 0.0), |(s, n), (_, (v, t))| (s + (v - t).powi(2), n + 1.0));
            (sum / n as f32).sqrt()
        };
        for (kind, most) in [(0, 0.5), (1, 0.6), (2, 1.05)] {
            let is = rms(&values, kind) / rms(&raw, kind);
            assert!(is < most, "{is} of the noise is left in kind {kind}");
        }
    }

    #[test]
    fn the_end_of_the_range_is_no_light_to_be_averaged() {
        let mut values = [0.97, 0.99, 1.0, 0.98, 1.0];
        let noise = FrameNoise::of(&[0.5; 3], 1, 0.05);
        steady(&mut values, 1, &noise, 1.0);
        assert_eq!(values.map(|v| v < 1.0), [true, true, false, true, false]);
        assert!((values[0] - 0.98).abs() < 1e-6 && (values[3] - 0.98).abs() < 1e-6, "{values:?}");
    }
}
