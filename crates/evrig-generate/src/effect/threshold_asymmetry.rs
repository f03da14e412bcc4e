//! Threshold asymmetry: rising and falling light take different changes to fire.
//!
//! The biases of the two comparators set the thresholds apart; their geometric mean stays nominal
//! (Lichtsteiner et al. 2008; DAVIS346 data). Signature: the ratio of On to Off events a cycle,
//! the same at every speed and brightness.

use super::{EffectModel, SignalStage, EffectParameter, PixelModel, PixelSite, parameter};
use serde::{Deserialize, Serialize};

/// On threshold over Off threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThresholdAsymmetry {
    /// On threshold over Off threshold; 1 for none.
    pub on_off_ratio: f64,
}

impl EffectModel for ThresholdAsymmetry {
    fn enters(&self) -> SignalStage {
        SignalStage::Thresholds
    }

    fn equation(&self) -> &'static str {
        "theta_on = theta sqrt(r), theta_off = theta / sqrt(r)"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![parameter("on_off_ratio", self.on_off_ratio, 0.05, 20.0)]
    }

    fn pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.threshold_on *= self.on_off_ratio.sqrt();
        pixel.threshold_off /= self.on_off_ratio.sqrt();
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
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
