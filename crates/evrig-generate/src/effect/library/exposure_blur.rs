//! Exposure blur: a frame sees light longer than stated.
//!
//! A frame is the mean of light over its exposure, so that fast change is weaker in it: by
//! sinc(f T), that is by (pi f T)^2/6 to first order. The generator puts back what the exposure
//! beyond the stated one took. Signature: real events outnumber simulated ones the faster it goes.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// What an exposure beyond the stated one took is put back.
    ExposureBlur, Frames, "x_true = x - (T^2/24) d2x/dt2" {
        /// Exposure beyond the stated one, µs.
        exposure_us: 0.0 to 1e5,
    }
}

impl EffectModel for ExposureBlur {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let steps = self.exposure_us * 1e-6 / signal.step_s();
        let apart = (0.5 * steps).round().max(1.0);
        add_curvature(signal.values, apart as usize, -steps * steps / 24.0 / (apart * apart));
    }
}

/// Adds `share` of the second difference over `apart` instants to each value that has both
/// neighbours.
fn add_curvature(values: &mut [f32], apart: usize, share: f64) {
    let before = values.to_vec();
    for i in apart..before.len().saturating_sub(apart) {
        let second = before[i - apart] - 2.0 * before[i] + before[i + apart];
        if second.is_finite() {
            values[i] += share as f32 * second;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn a_blurred_light_gives_the_events_of_the_sharp_one() {
        let (hz, exposure) = (10.0_f64, 0.02);
        let blur =
            (std::f64::consts::PI * hz * exposure).sin() / (std::f64::consts::PI * hz * exposure);
        let sine = |amplitude: f64| {
            synthetic(move |[x, _], t| {
                amplitude * (std::f64::consts::TAU * (hz * t + x / 16.0)).sin() - 1.0
            })
        };
        let sharp = events(&sine(0.8), 1.0, &[]).len() as f64;
        let blurred = events(&sine(0.8 * blur), 1.0, &[]).len() as f64;
        let restored =
            events(&sine(0.8 * blur), 1.0, &["exposure_blur:exposure_us=20000"]).len() as f64;
        assert!(blurred / sharp < 0.96, "{blurred} {sharp}");
        assert!((restored / sharp - 1.0).abs() < 0.015, "{restored} {sharp}");
    }
}
