//! Frame interpolation: what happens between two frames is not a straight line.
//!
//! Between its frames a drive from frames is straight in log intensity; light that passes smoothly
//! is nearer the cubic through four frames (Catmull and Rom 1974). Signature: residuals locked to
//! the phase between frames, stronger the faster the light changes.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, RecordingContext, SiteSignal};

effect! {
    /// A share of the way from straight lines to cubics between frames.
    FrameInterpolation, Frames, "x = (1 - s) line + s cubic between frames" {
        /// 0 leaves the lines, 1 takes the cubic.
        share: 0.0 to 1.0,
    }
}

impl EffectModel for FrameInterpolation {
    fn missing_input(&self, context: &RecordingContext) -> Option<&'static str> {
        (context.frame_times_us.len() < 4).then_some("the times of at least four frames")
    }

    fn apply_to_signal(&self, site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let grid = signal.grid();
        let knots: Vec<f64> =
            site.context.frame_times_us.iter().map(|&t| grid.position(t as f64)).collect();
        let before = signal.values.to_vec();
        let at = |t: f64| -> Option<f64> {
            let i = t.floor();
            if i < 0.0 || i as usize + 1 >= before.len() {
                return None;
            }
            let (i, u) = (i as usize, t - i);
            let value = f64::from(before[i]) * (1.0 - u) + f64::from(before[i + 1]) * u;
            value.is_finite().then_some(value)
        };
        for frames in knots.windows(4) {
            let &[a, b, c, d] = frames else { continue };
            let (Some(xa), Some(xb), Some(xc), Some(xd)) = (at(a), at(b), at(c), at(d)) else {
                continue;
            };
            let (m0, m1) = ((xc - xa) / (c - a) * (c - b), (xd - xb) / (d - b) * (c - b));
            for i in b.ceil() as usize..=(c.floor() as usize).min(before.len() - 1) {
                let u = (i as f64 - b) / (c - b);
                let bend = u * (1.0 - u) * ((1.0 - u) * (m0 - (xc - xb)) - u * (m1 - (xc - xb)));
                signal.values[i] += (self.share * bend) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::pixel_site::RecordingContext;
    use crate::effect::test_support::*;

    #[test]
    fn a_light_sampled_by_frames_is_smooth_again_as_far_as_the_share_goes() {
        let interval = 0.025;
        let wave =
            |x: f64, t: f64| 0.9 * (std::f64::consts::TAU * (4.0 * t + x / 16.0)).sin() - 1.0;
        let smooth = synthetic(move |[x, _], t| wave(x, t));
        let sampled = synthetic(move |[x, _], t: f64| {
            let frame = (t / interval).floor();
            let u = t / interval - frame;
            (1.0 - u) * wave(x, frame * interval) + u * wave(x, (frame + 1.0) * interval)
        });
        let around = RecordingContext {
            frame_times_us: (-4..60).map(|i| 25_000 * i).collect(),
            ..RecordingContext::default()
        };
        let truth = signal_behind(&smooth, &[], around.clone());
        let error = |share: &str| {
            let found = signal_behind(
                &sampled,
                &[&format!("frame_interpolation:share={share}")],
                around.clone(),
            );
            found[100..1900]
                .iter()
                .zip(&truth[100..1900])
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max)
        };
        let (lines, half, cubic) = (error("0"), error("0.5"), error("1"));
        assert!(lines > 0.03 && cubic < 0.2 * lines, "{lines} {cubic}");
        assert!((half / lines - 0.5).abs() < 0.15, "{half} {lines}");
    }
}
