//! Flicker: the light pulsates.
//!
//! Lamps on alternating current, or dimmed by pulses, modulate all light alike. Signature: a line
//! in the spectrum of events that all pixels share in phase.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};
use std::f64::consts::TAU;

effect! {
    /// A sine on the intensity of all light.
    Flicker, Light, "I_seen = I (1 + m sin(2 pi f (t - t_0) + phi))" {
        /// Frequency, Hz.
        frequency_hz: 0.01 to 1e5,
        /// Amplitude over mean.
        depth: 0.0 to 0.99,
        /// Phase of the sine at `phase_at_us`, degrees.
        #[serde(default)]
        phase_deg: -360.0 to 360.0,
        /// Instant of the phase, µs.
        #[serde(default)]
        phase_at_us: -1e18 to 1e18,
    }
}

impl EffectModel for Flicker {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let grid = signal.grid();
        for (i, x) in signal.values.iter_mut().enumerate() {
            let t_s = (grid.at(i) as f64 - self.phase_at_us) * 1e-6;
            let phase = TAU * (self.frequency_hz * t_s).fract() + self.phase_deg.to_radians();
            *x += (self.depth * phase.sin()).ln_1p() as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    use std::f64::consts::TAU;

    #[test]
    fn still_pixels_fire_in_step_with_the_lamp() {
        let all = events(&still(-1.0), 1.0, &["flicker:frequency_hz=100,depth=0.3"]);
        let line = |hz: f64| {
            let phase = |t: i64| TAU * hz * t as f64 * 1e-6;
            let on = all.iter().filter(|e| e.on);
            let (c, s) =
                on.fold((0.0, 0.0), |(c, s), e| (c + phase(e.t).cos(), s + phase(e.t).sin()));
            c.hypot(s) / all.len() as f64
        };
        assert!(all.len() > 2 * 90 * SIZE.n_pixels());
        assert!(line(100.0) > 0.3 && line(93.0) < 0.05, "{} {}", line(100.0), line(93.0));
    }
}
