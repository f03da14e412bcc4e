//! Junction leak: the reset switch leaks, and the voltage rises by itself.
//!
//! The junction of the reset transistor discharges the floating node of the differencing amplifier;
//! seen from the comparator the light seems to rise (Nozaki and Delbruck, IEEE T-ED 2017).
//! Signature: near-periodic ON events at a rate that light does not change, also in the dark.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;

effect! {
    /// ON events at a constant rate.
    JunctionLeak, Drift, "dV = R dt" {
        /// Nominal thresholds a second; one ON event each.
        rate_hz: 0.0 to 1000.0,
    }
}

impl EffectModel for JunctionLeak {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.leak_hz += self.rate_hz;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn a_still_pixel_fires_on_at_even_intervals_in_light_and_in_the_dark() {
        for level in [0.0, -4.0] {
            let all = events(&still(level), 4.0, &["junction_leak:rate_hz=2"]);
            assert!((share_on(&all) - 1.0).abs() < 1e-9);
            let (mean, sd) = mean_and_sd(intervals(&all).iter().map(|&gap| gap as f64));
            assert!((mean - 500_000.0).abs() < 2.0 && sd < 2.0, "{mean} {sd}");
        }
    }
}
