//! Adaptation: a part of the signal is forgotten slowly.
//!
//! The photoreceptor's feedback adapts, and the differencing capacitor leaks towards the mean: both
//! high-pass the signal with a time constant of seconds (Delbruck and Mead 1996). Signature: slow
//! change gives fewer events than fast, and a pixel fires back after a lasting step.

use crate::effect::low_pass::low_pass;
use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// A share of the signal is high-passed.
    Adaptation, Photoreceptor, "y = x - a z, T dz/dt = x - z" {
        /// Time constant, s.
        time_constant_s: 0.001 to 1e4,
        /// Share of the signal that is forgotten.
        fraction: 0.0 to 1.0,
    }
}

impl EffectModel for Adaptation {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let mut forgotten = signal.values.to_vec();
        let tau = self.time_constant_s / signal.step_s();
        low_pass(&mut forgotten, |_| tau);
        let fraction = self.fraction as f32;
        signal.values.iter_mut().zip(forgotten).for_each(|(x, z)| *x -= fraction * z);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
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
