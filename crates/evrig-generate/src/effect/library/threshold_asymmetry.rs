//! Threshold asymmetry: rising and falling light take different changes to fire.
//!
//! The biases of the two comparators set the thresholds apart; their geometric mean stays nominal
//! (Lichtsteiner et al. 2008; DAVIS346 data). Signature: the ratio of ON to OFF events a cycle,
//! the same at every speed and brightness.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;

effect! {
    /// ON threshold over OFF threshold.
    ThresholdAsymmetry, Thresholds, "theta_on = theta sqrt(r), theta_off = theta / sqrt(r)" {
        /// ON threshold over OFF threshold; 1 for none.
        on_off_ratio: 0.05 to 20.0,
    }
}

impl EffectModel for ThresholdAsymmetry {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.threshold_on *= self.on_off_ratio.sqrt();
        pixel.threshold_off /= self.on_off_ratio.sqrt();
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn over_whole_cycles_the_sides_balance_by_their_thresholds() {
        let light = passing(1.0, -1.0);
        for ratio in [0.5, 0.8, 1.5] {
            let all = events(&light, 16.0, &[&format!("threshold_asymmetry:on_off_ratio={ratio}")]);
            let on = share_on(&all);
            let found = (1.0 - on) / on;
            assert!((found / ratio - 1.0).abs() < 0.03, "{found} for {ratio}");
        }
    }
}
