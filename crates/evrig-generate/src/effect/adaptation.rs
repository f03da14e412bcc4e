//! Adaptation: a part of the signal is forgotten slowly.
//!
//! The photoreceptor's feedback adapts, and the differencing capacitor leaks towards the mean: both
//! high-pass the signal with a time constant of seconds (Delbruck and Mead 1996). Signature: slow
//! change gives fewer events than fast, and a pixel fires back after a lasting step.

use super::low_pass::low_pass;
use super::{EffectModel, SignalStage, PixelSignal, EffectParameter, PixelSite, parameter};
use serde::{Deserialize, Serialize};

/// A share of the signal is high-passed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Adaptation {
    /// Time constant, s.
    pub time_constant_s: f64,
    /// Share of the signal that is forgotten.
    pub fraction: f64,
}

impl EffectModel for Adaptation {
    fn enters(&self) -> SignalStage {
        SignalStage::Photoreceptor
    }

    fn equation(&self) -> &'static str {
        "y = x - a z, T dz/dt = x - z"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![
            parameter("time_constant_s", self.time_constant_s, 0.001, 10000.0),
            parameter("fraction", self.fraction, 0.0, 1.0),
        ]
    }

    fn light(&self, _site: &PixelSite<'_>, light: &mut PixelSignal<'_>) {
        let mut forgotten = light.values.to_vec();
        let tau = self.time_constant_s / light.step_s();
        low_pass(&mut forgotten, |_| tau);
        let fraction = self.fraction as f32;
        light.values.iter_mut().zip(forgotten).for_each(|(x, z)| *x -= fraction * z);
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
    #[test]
    fn after_a_step_the_pixel_fires_back_while_it_forgets() {
        let step = synthetic(|_, t| if t < 0.5 { -2.0 } else { -0.5 });
        let all = events(&step, 3.0, &["adaptation:time_constant_s=0.3,fraction=0.6"]);
        let n =
            |on: bool| all.iter().filter(|e| e.on == on).count() as f64 / SIZE.n_pixels() as f64;
        // 7.5 thresholds up at once, then 60 % of it back.
        assert!(
            (n(true) - 7.0).abs() < 0.1 && (n(false) - 4.0).abs() < 1.1,
            "{} {}",
            n(true),
            n(false)
        );
        assert!(all.iter().filter(|e| !e.on).all(|e| e.t > 510_000));
        assert!(events(&step, 3.0, &[]).iter().all(|e| e.on));
    }
}
