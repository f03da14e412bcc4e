//! Frame noise: the frames are noisier than stated.
//!
//! Noise of the frames looks to a generator like change of light, once an interval. Where the
//! second difference of three frames is no larger than the noise would make it, the middle one is
//! replaced by their mean, the best estimate for light that is straight over them; where it is
//! larger, in part. Signature: simulated events of still pixels at the frames' rhythm that the
//! camera lacks.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, RecordingContext, SiteSignal};

effect! {
    /// Noise of that size is smoothed out of the frames.
    FrameNoise, Frames, "x_true = x + w (x_before - 2 x + x_after)/3, w = min(1, 6 (sigma/L)^2 / \
        second difference squared)" {
        /// Standard deviation of a pixel in a frame beyond the stated one, digital units.
        sigma_dn: 0.0 to 1e4,
    }
}

impl EffectModel for FrameNoise {
    fn missing_input(&self, context: &RecordingContext) -> Option<&'static str> {
        (context.frame_times_us.len() < 3).then_some("the times of at least three frames")
    }

    fn apply_to_signal(&self, site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let times = &site.context.frame_times_us;
        let span = times.last().zip(times.first()).map_or(0, |(last, first)| last - first);
        let interval_us = span as f64 / (times.len() - 1).max(1) as f64;
        let apart = (interval_us * 1e-6 / signal.step_s()).round().max(1.0) as usize;
        let relative = (self.sigma_dn / site.white_dn) as f32;
        let before = signal.values.to_vec();
        for i in apart..before.len().saturating_sub(apart) {
            let second = before[i - apart] - 2.0 * before[i] + before[i + apart];
            let variance = 6.0 * (relative / before[i].exp()).powi(2);
            let weight = (variance / (second * second).max(f32::MIN_POSITIVE)).min(1.0);
            if weight.is_finite() && second.is_finite() {
                signal.values[i] += weight * second / 3.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::pixel_site::RecordingContext;
    use crate::effect::test_support::*;

    #[test]
    fn noise_of_frames_makes_fewer_events_and_motion_keeps_its_own() {
        let around = RecordingContext {
            frame_times_us: (0..101).map(|i| 10_000 * i).collect(),
            ..RecordingContext::default()
        };
        // White noise at the frames, straight between them, 6 DN at a level of 60.
        let noise = |place: [f64; 2], frame: f64| {
            let hash = ((place[0] * 7_919.0 + place[1] * 104_729.0 + frame * 1_299.7).sin()
                * 43_758.5)
                .fract();
            0.1 * hash * 3.0_f64.sqrt()
        };
        let still = synthetic(move |place, t: f64| {
            let (frame, u) = ((t / 0.01).floor(), (t / 0.01).fract());
            -1.2 + (1.0 - u) * noise(place, frame) + u * noise(place, frame + 1.0)
        });
        let words = ["frame_noise:sigma_dn=6"];
        let raw = events(&still, 1.0, &[]).len();
        let smooth = events_in(&still, 1.0, &words, around.clone()).len();
        assert!(raw > 1_000 && smooth < raw / 3, "{raw} {smooth}");
        let light = passing(1.0, -1.2);
        let n_moving = events(&light, 1.0, &[]).len() as f64;
        let kept = events_in(&light, 1.0, &words, around).len() as f64 / n_moving;
        assert!(kept > 0.97, "{kept}");
    }
}
