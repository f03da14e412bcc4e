//! Tone curve: the frames are not linear in light.
//!
//! An image processor's gamma raises the light to a power; the generator takes the root. Signature:
//! a gain on all contrast of the frames that a brightness step reveals.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// The frames are a power of the light.
    ToneCurve, Frames, "frame ~ I^gamma, so x_true = x / gamma" {
        /// Exponent of the light in the frames; 1 when they are linear.
        gamma: 0.1 to 10.0,
    }
}

impl EffectModel for ToneCurve {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let gamma = self.gamma as f32;
        signal.values.iter_mut().for_each(|x| *x /= gamma);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn contrast_is_what_it_was_before_the_curve() {
        let wave = |x: f64, t: f64| 0.8 * (12.0 * t + x).sin() - 1.5;
        let truth = events(&synthetic(move |[x, _], t| wave(x, t)), 2.0, &[]).len() as f64;
        let bent = synthetic(move |[x, _], t| 0.45 * wave(x, t));
        assert!((events(&bent, 2.0, &[]).len() as f64) < 0.6 * truth);
        let corrected = events(&bent, 2.0, &["tone_curve:gamma=0.45"]).len() as f64;
        assert!((corrected / truth - 1.0).abs() < 2e-3, "{corrected} {truth}");
    }
}
