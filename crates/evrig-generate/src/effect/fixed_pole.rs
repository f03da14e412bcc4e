//! Fixed pole: a stage behind the photoreceptor that is slow whatever the light.
//!
//! The source follower between photoreceptor and differencing amplifier, limited by its bias
//! current (Graca and Delbruck, arXiv 2109.08640). Signature: a lag equal in light and dark, and
//! fewer events the faster the light changes.

use super::low_pass::{low_pass, tau_steps};
use super::{EffectModel, SignalStage, PixelSignal, EffectParameter, PixelSite, parameter};
use serde::{Deserialize, Serialize};

/// One pole at a constant cut-off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedPole {
    /// Cut-off (-3 dB), Hz.
    pub cutoff_hz: f64,
}

impl EffectModel for FixedPole {
    fn enters(&self) -> SignalStage {
        SignalStage::Photoreceptor
    }

    fn equation(&self) -> &'static str {
        "tau dy/dt = x - y, tau = 1/(2 pi f)"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![parameter("cutoff_hz", self.cutoff_hz, 0.1, 1000000.0)]
    }

    fn light(&self, _site: &PixelSite<'_>, light: &mut PixelSignal<'_>) {
        let tau = tau_steps(self.cutoff_hz, light.step_s());
        low_pass(light.values, |_| tau);
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
    #[test]
    fn the_lag_is_that_of_the_pole_in_light_and_in_the_dark() {
        for level in [-0.6, -3.0] {
            let light = passing(0.5, level);
            let plain = events(&light, 2.0, &[]);
            let slow = events(&light, 2.0, &["fixed_pole:cutoff_hz=30"]);
            let found = mean_lag(&plain, &slow);
            assert!((found / 5_305.0 - 1.0).abs() < 0.05, "{found}");
        }
    }
}
