//! Defocus: the event camera's lens is less sharp than the drive assumes.
//!
//! A blur of Gaussian shape over the light; its mean is taken at nine places that are exact for
//! light of up to the fifth power of place (Gauss and Hermite). Signature: fewer events at fine
//! structure, the same at every speed.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// A Gaussian blur of the light in front of the pixel.
    Defocus, Optics, "I_seen = I * Gaussian of sigma" {
        /// Standard deviation of the blur, event pixels.
        sigma_px: 0.0 to 20.0,
    }
}

/// Weights of Gauss-Hermite's three places in one direction.
const SHARES: [f32; 3] = [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0];

impl EffectModel for Defocus {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let far = 3.0_f64.sqrt() * self.sigma_px;
        let places = [-far, 0.0, far];
        let offsets: [[f64; 2]; 9] = std::array::from_fn(|i| [places[i % 3], places[i / 3]]);
        let weights: [f32; 9] = std::array::from_fn(|i| SHARES[i % 3] * SHARES[i / 3]);
        signal.add_from_around(offsets, |there, _, _| {
            there.iter().zip(weights).map(|(x, weight)| weight * x.exp()).sum::<f32>().ln()
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    use std::f64::consts::TAU;

    #[test]
    fn fine_stripes_lose_contrast_as_a_gaussian_predicts_at_any_speed() {
        let stripes = |amplitude: f64, hz: f64| {
            synthetic(move |[x, _], t| {
                (0.3 * (1.0 + amplitude * (TAU * (hz * t + x / 12.0)).sin())).ln()
            })
        };
        let left = (-0.5 * (TAU * 1.5 / 12.0_f64).powi(2)).exp();
        for hz in [1.0, 5.0] {
            let seen = events(&stripes(0.8, hz), 2.0, &["defocus:sigma_px=1.5"]).len() as f64;
            let expected = events(&stripes(0.8 * left, hz), 2.0, &[]).len() as f64;
            let sharp = events(&stripes(0.8, hz), 2.0, &[]).len() as f64;
            assert!((seen / expected - 1.0).abs() < 0.03, "{seen} {expected} {sharp}");
            assert!(seen < 0.8 * sharp);
        }
    }
}
