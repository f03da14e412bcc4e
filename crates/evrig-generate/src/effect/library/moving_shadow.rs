//! Moving shadow: a shadow crosses the target.
//!
//! A soft band of less light that runs over the image from left to right, and again when it has
//! left. Its width and speed are not among the stable parameters and have defaults. Signature:
//! OFF events, then ON events, in a band that does not move with the image.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// A band of shadow of Gaussian shape.
    MovingShadow, Light, "I_seen = I (1 - m exp(-(x - v t)^2 / (2 w^2)))" {
        /// Share of light that is missing in its middle.
        depth: 0.0 to 0.99,
        /// Standard deviation of its shape, event pixels.
        #[serde(default = "width_px")]
        width_px: 0.5 to 1e4,
        /// Speed across the image, event pixels a second.
        #[serde(default = "speed_px_per_s")]
        speed_px_per_s: 1.0 to 1e5,
        /// An instant at which its middle is three widths left of the image, µs.
        #[serde(default)]
        enters_at_us: -1e18 to 1e18,
    }
}

const fn width_px() -> f64 {
    40.0
}

const fn speed_px_per_s() -> f64 {
    100.0
}

impl EffectModel for MovingShadow {
    fn apply_to_signal(&self, site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let way_px = f64::from(site.size.width) + 6.0 * self.width_px;
        let (grid, x_px) = (signal.grid(), f64::from(site.x) + 0.5 + 3.0 * self.width_px);
        for (i, x) in signal.values.iter_mut().enumerate() {
            let t_s = (grid.at(i) as f64 - self.enters_at_us) * 1e-6;
            let middle = (self.speed_px_per_s * t_s).rem_euclid(way_px);
            let far = (x_px - middle) / self.width_px;
            *x += (-self.depth * (-0.5 * far * far).exp()).ln_1p() as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn a_still_image_fires_off_in_front_of_the_shadow_and_on_behind_it() {
        let words = ["moving_shadow:depth=0.6,width_px=5,speed_px_per_s=50"];
        let all = events(&still(-1.0), 1.8, &words);
        assert!(all.len() > 4 * SIZE.n_pixels());
        for event in &all {
            let shadow = 50.0 * event.t as f64 * 1e-6 - 15.0;
            assert_eq!(event.on, f64::from(event.x) + 0.5 < shadow + 0.1, "{event:?}");
        }
    }
}
