//! Background activity: events at random times, without memory.
//!
//! The simplest account of noise events: a Poisson process in each pixel, sides at random, that
//! leaves the pixel's reference alone (Hu et al., v2e, 2021, "shot noise" of its first release).
//! Signature: exponential intervals, alternation one half, whatever the light.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;

effect! {
    /// A Poisson process in each pixel.
    BackgroundActivity, Noise, "events at rate R, On with probability 1/2" {
        /// Events a second and pixel, half of them ON.
        rate_hz: 0.0 to 1e4,
    }
}

impl EffectModel for BackgroundActivity {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.spontaneous_hz += self.rate_hz;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn still_pixels_fire_at_random_with_half_the_sides_turning() {
        let all = events(&still(-1.0), 10.0, &["background_activity:rate_hz=5"]);
        let (mean, sd) = mean_and_sd(counts(&all));
        assert!((mean - 50.0).abs() < 0.6, "{mean}");
        assert!((sd * sd / mean - 1.0).abs() < 0.1, "{sd}");
        assert!((alternation(&all) - 0.5).abs() < 0.01);
        assert!((share_on(&all) - 0.5).abs() < 0.01);
    }
}
