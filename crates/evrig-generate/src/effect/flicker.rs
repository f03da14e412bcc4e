//! Flicker: the light pulsates.
//!
//! Lamps on alternating current, or dimmed by pulses, modulate all light alike. Signature: a line
//! in the spectrum of events that all pixels share in phase.

use super::{EffectModel, SignalStage, PixelSignal, EffectParameter, PixelSite, parameter};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A sine on the intensity of all light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flicker {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude over mean.
    pub depth: f64,
    /// Phase of the sine at `phase_at_us`, degrees.
    #[serde(default)]
    pub phase_deg: f64,
    /// Instant of the phase, µs.
    #[serde(default)]
    pub phase_at_us: f64,
}

impl EffectModel for Flicker {
    fn enters(&self) -> SignalStage {
        SignalStage::Light
    }

    fn equation(&self) -> &'static str {
        "I_seen = I (1 + m sin(2 pi f (t - t_0) + phi))"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![
            parameter("frequency_hz", self.frequency_hz, 0.01, 100000.0),
            parameter("depth", self.depth, 0.0, 0.99),
            parameter("phase_deg", self.phase_deg, -360.0, 360.0),
            parameter("phase_at_us", self.phase_at_us, -1e+18, 1e+18),
        ]
    }

    fn light(&self, _site: &PixelSite<'_>, light: &mut PixelSignal<'_>) {
        let grid = light.grid();
        for (i, x) in light.values.iter_mut().enumerate() {
            let t_s = (grid.at(i) as f64 - self.phase_at_us) * 1e-6;
            let phase = TAU * (self.frequency_hz * t_s).fract() + self.phase_deg.to_radians();
            *x += (self.depth * phase.sin()).ln_1p() as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
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
