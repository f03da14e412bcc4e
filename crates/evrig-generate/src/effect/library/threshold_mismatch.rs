//! Threshold mismatch: each pixel has thresholds of its own.
//!
//! Transistor mismatch in the comparators sets both thresholds of a pixel apart from the nominal
//! ones, ON and OFF independently and for good (Lichtsteiner et al. 2008; Hu et al., v2e, 2021;
//! Wang et al. 2020). Signature: counts differ from pixel to pixel and do so again in every
//! segment.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;
use evrig_core::effect_id::EffectId;

effect! {
    /// Normal spread of both thresholds of a pixel.
    ThresholdMismatch, Thresholds, "theta_p = theta (1 + sigma z_p), z_p standard normal, On and \
        Off drawn apart" {
        /// Standard deviation over the nominal threshold.
        sigma_relative: 0.0 to 1.0,
    }
}

/// No threshold is less than this share of the nominal one.
const MIN_THRESHOLD_RATIO: f64 = 0.1;

impl EffectModel for ThresholdMismatch {
    fn apply_to_pixel(&self, site: &PixelSite<'_>, pixel: &mut PixelModel) {
        let mut draws = site.draws(EffectId::ThresholdMismatch);
        let mut factor = || (1.0 + self.sigma_relative * draws.normal()).max(MIN_THRESHOLD_RATIO);
        pixel.threshold_on *= factor();
        pixel.threshold_off *= factor();
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn counts_scatter_from_pixel_to_pixel_and_do_so_again() {
        let light = passing(4.0, -1.0);
        let words = ["threshold_mismatch:sigma_relative=0.1"];
        let all = events(&light, 8.0, &words);
        let (first, second): (Vec<_>, Vec<_>) = all.iter().partition(|e| e.t < 4_000_000);
        let (first, second) = (counts(&first), counts(&second));
        let (mean, sd) = mean_and_sd(first.iter().copied());
        assert!(sd / mean > 0.05, "{sd} of {mean}");
        let (_, change) = mean_and_sd(first.iter().zip(&second).map(|(a, b)| a - b));
        assert!(change < 0.5 * sd, "{change} against {sd}");
        let (_, plain) = mean_and_sd(counts(&events(&light, 4.0, &[])));
        assert!(plain < 0.5 * sd);
    }
}
