//! Photocurrent leak: light that falls on the reset switch makes it leak.
//!
//! Parasitic photocurrent in the junction of the reset transistor grows with the light on the chip
//! (Nozaki and Delbruck, "Temperature and parasitic photocurrent effects in dynamic vision
//! sensors", IEEE T-ED 2017). Signature: ON events of still pixels at a rate linear in light.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;

effect! {
    /// ON events at a rate proportional to light.
    PhotocurrentLeak, Drift, "dV = R_white (I / I_white) dt" {
        /// Nominal thresholds a second on white paper.
        rate_hz_at_white: 0.0 to 1000.0,
    }
}

impl EffectModel for PhotocurrentLeak {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.leak_hz_at_white += self.rate_hz_at_white;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn a_still_pixel_fires_on_in_proportion_to_its_light() {
        for level in [0.0, -0.7, -1.6] {
            let all = events(&still(level), 4.0, &["photocurrent_leak:rate_hz_at_white=10"]);
            assert!((share_on(&all) - 1.0).abs() < 1e-9);
            let (mean, _) = mean_and_sd(intervals(&all).iter().map(|&gap| gap as f64));
            assert!((mean * level.exp() / 1e5 - 1.0).abs() < 1e-4, "{mean} at {level}");
        }
    }
}
