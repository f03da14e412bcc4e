//! Fixed pole: a stage behind the photoreceptor that is slow whatever the light.
//!
//! The source follower between photoreceptor and differencing amplifier, limited by its bias
//! current (Graca and Delbruck, arXiv 2109.08640). Signature: a lag equal in light and dark, and
//! fewer events the faster the light changes.

use crate::effect::low_pass::{low_pass, tau_steps};
use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// One pole at a constant cut-off.
    FixedPole, Photoreceptor, "tau dy/dt = x - y, tau = 1/(2 pi f)" {
        /// Cut-off (-3 dB), Hz.
        cutoff_hz: 0.1 to 1e6,
    }
}

impl EffectModel for FixedPole {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let tau = tau_steps(self.cutoff_hz, signal.step_s());
        low_pass(signal.values, |_| tau);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
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
