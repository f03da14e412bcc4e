//! Hot pixels: a few pixels fire by themselves.
//!
//! A defect makes the reset switch of a pixel leak thousands of times more than its neighbours', so
//! it fires ON steadily. Rates spread over two decades about `rate_hz`. Signature: a second mode
//! far out in the pixels' rates while nothing moves.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;
use evrig_core::effect_id::EffectId;

effect! {
    /// Pixels with a leak of their own.
    HotPixels, Drift, "dV = R_p dt in a share of the pixels, log10 R_p uniform over 2 decades" {
        /// Share of the pixels.
        fraction: 0.0 to 1.0,
        /// Middle of their rates on a logarithmic scale, Hz.
        #[serde(default = "rate_hz")]
        rate_hz: 0.1 to 1e4,
    }
}

const fn rate_hz() -> f64 {
    100.0
}

impl EffectModel for HotPixels {
    fn apply_to_pixel(&self, site: &PixelSite<'_>, pixel: &mut PixelModel) {
        let mut draws = site.draws(EffectId::HotPixels);
        if draws.uniform() < self.fraction {
            pixel.leak_hz += self.rate_hz * 10_f64.powf(2.0 * draws.uniform() - 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn the_stated_share_of_pixels_fires_while_nothing_moves() {
        let all = events(&still(-1.0), 1.0, &["hot_pixels:fraction=0.05"]);
        let counts = counts(&all);
        let n_hot = counts.iter().filter(|&&n| n > 5.0).count() as f64;
        assert!((n_hot / counts.len() as f64 - 0.05).abs() < 0.02, "{n_hot}");
        assert!(counts.iter().all(|&n| n == 0.0 || (5.0..1000.0).contains(&n)));
    }
}
