//! Vignetting: the event camera's image darkens towards its corners.
//!
//! A factor on light cancels in its logarithm; what is left shows through all that depends on
//! brightness: bandwidth, noise, leak, dark current (cos^4 law and lens stops). Signature: those
//! effects grow with the distance from the middle.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// Loss of light that grows with the square of the distance from the middle.
    Vignetting, Optics, "I_seen = I (1 - loss (r / r_corner)^2)" {
        /// Share of light that is lost in the corners.
        corner_loss: 0.0 to 0.99,
    }
}

impl EffectModel for Vignetting {
    fn apply_to_signal(&self, site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let [x, y] = site.from_middle();
        let half = [site.size.width, site.size.height].map(|n| 0.5 * f64::from(n));
        let share = (x * x + y * y) / (half[0] * half[0] + half[1] * half[1]);
        let loss = (1.0 - self.corner_loss * share).ln() as f32;
        signal.values.iter_mut().for_each(|x| *x += loss);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn what_goes_with_light_is_less_in_the_corners() {
        let leak = "photocurrent_leak:rate_hz_at_white=40";
        let all = events(&still(0.0), 4.0, &[leak, "vignetting:corner_loss=0.5"]);
        let counts = counts(&all);
        let (corner, middle) = (counts[0], counts[SIZE.index(30, 20)]);
        assert!((corner / middle - 0.5).abs() < 0.05, "{corner} {middle}");
    }
}
