//! Vignetting: the event camera's picture darkens towards its corners.
//!
//! A factor on light cancels in its logarithm; what is left shows through all that depends on
//! brightness: bandwidth, noise, leak, dark current (cos^4 law and lens stops). Signature: those
//! effects grow with the distance from the middle.

use super::{EffectModel, SignalStage, PixelSignal, EffectParameter, PixelSite, parameter};
use serde::{Deserialize, Serialize};

/// Loss of light that grows with the square of the distance from the middle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vignetting {
    /// Share of light that is lost in the corners.
    pub corner_loss: f64,
}

impl EffectModel for Vignetting {
    fn enters(&self) -> SignalStage {
        SignalStage::Optics
    }

    fn equation(&self) -> &'static str {
        "I_seen = I (1 - loss (r / r_corner)^2)"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![parameter("corner_loss", self.corner_loss, 0.0, 0.99)]
    }

    fn light(&self, site: &PixelSite<'_>, light: &mut PixelSignal<'_>) {
        let [x, y] = site.from_middle();
        let half = [site.size.width, site.size.height].map(|n| 0.5 * f64::from(n));
        let share = (x * x + y * y) / (half[0] * half[0] + half[1] * half[1]);
        let loss = (1.0 - self.corner_loss * share).ln() as f32;
        light.values.iter_mut().for_each(|x| *x += loss);
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
    #[test]
    fn what_goes_with_light_is_less_in_the_corners() {
        let leak = "photocurrent_leak:rate_hz_at_white=40";
        let all = events(&still(0.0), 4.0, &[leak, "vignetting:corner_loss=0.5"]);
        let counts = counts(&all);
        let (corner, middle) = (counts[0], counts[SIZE.index(30, 20)]);
        assert!((corner / middle - 0.5).abs() < 0.05, "{corner} {middle}");
    }
}
