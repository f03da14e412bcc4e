//! Photoreceptor bandwidth: the photoreceptor is slower the darker it is.
//!
//! The photocurrent charges the input node, so its pole goes with light; a second stage of equal
//! order is common in models (Lichtsteiner et al. 2008; Hu et al., v2e, 2021; Graca and Delbruck
//! 2021, 2025). Signature: lag proportional to 1/I, and fewer events the faster and darker.

use crate::effect::low_pass::{low_pass, tau_steps};
use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// Poles whose cut-off is proportional to light.
    PhotoreceptorBandwidth, Photoreceptor, "tau(I) dy/dt = ln I - y, tau = 1/(2 pi f_white I), I \
        over white" {
        /// Cut-off (-3 dB) of each pole on white paper, Hz.
        cutoff_hz_at_white: 0.1 to 1e6,
        /// Number of equal poles, 1 to 4; rounded.
        order: 1.0 to 4.0,
    }
}

/// Log intensity over white below which the pole gets no slower: dark current keeps it going.
const MIN_LOG_INTENSITY: f32 = -9.0;

impl EffectModel for PhotoreceptorBandwidth {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let tau_at_white = tau_steps(self.cutoff_hz_at_white, signal.step_s());
        for _ in 0..self.order.round() as usize {
            // The pole follows the light itself, of which the filtered signal is a fair account.
            low_pass(signal.values, |x| tau_at_white / f64::from(x.max(MIN_LOG_INTENSITY)).exp());
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    use std::f64::consts::TAU;

    #[test]
    fn events_of_a_slope_lag_in_proportion_to_darkness_and_order() {
        let words =
            |order: u32| format!("photoreceptor_bandwidth:cutoff_hz_at_white=40,order={order}");
        // Slow and small, so that the pole hardly moves: a stripe of 1 Hz.
        for (level, order) in [(0.0, 1), (-1.0, 1), (0.0, 2)] {
            let light = synthetic(move |[x, _], t| level + 0.25 * (TAU * (t + x / 16.0)).sin());
            let plain = events(&light, 2.0, &[]);
            let slow = events(&light, 2.0, &[&words(order)]);
            let expected = f64::from(order) * 1e6 / (TAU * 40.0 * level.exp());
            let found = mean_lag(&plain, &slow);
            assert!((found / expected - 1.0).abs() < 0.1, "{found} for {expected}");
        }
    }

    #[test]
    fn fast_stripes_lose_more_events_than_slow_ones() {
        let words = ["photoreceptor_bandwidth:cutoff_hz_at_white=20,order=1"];
        let kept = |hz: f64| {
            let light = passing(hz, -1.0);
            events(&light, 2.0, &words).len() as f64 / events(&light, 2.0, &[]).len() as f64
        };
        let (slow, fast) = (kept(1.0), kept(12.0));
        assert!(slow > 0.9 && fast < 0.7, "{slow} {fast}");
    }
}
