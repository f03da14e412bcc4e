//! The model of an event pixel on a continuous log-intensity signal.

use crate::voltmeter::Coefficients;
use serde::{Deserialize, Serialize};

/// Constants of an event pixel. Its voltage is in units of the nominal threshold:
///
/// V(t) = gain (ln(I + floor) at t, less that at the last reset) + leak + noise
///
/// with I the intensity over white. It fires ON at `threshold_on`, OFF at `-threshold_off`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelModel {
    /// Nominal thresholds a unit of log intensity.
    pub gain: f64,
    /// Offset inside the logarithm, relative to white.
    pub floor_of_white: f64,
    /// Rise that fires ON, nominal thresholds; above 0.
    pub threshold_on: f64,
    /// Fall that fires OFF, nominal thresholds; above 0.
    pub threshold_off: f64,
    /// Rise of the voltage whatever the light, thresholds a second.
    pub leak_hz: f64,
    /// Rise of the voltage at white, in proportion to the light, thresholds a second.
    pub leak_hz_at_white: f64,
    /// Growth of the leak since the start of the window, thresholds a second and second.
    pub leak_hz_per_s: f64,
    /// White noise √I/(I + floor) in proportion: its factor, thresholds a root second.
    pub shot_per_sqrt_s: f64,
    /// White noise whatever the light, thresholds a root second.
    pub white_per_sqrt_s: f64,
    /// Band-limited noise.
    pub band: Option<BandNoise>,
    /// Scatter of the thresholds.
    pub scatter: Option<ThresholdScatter>,
    /// Delay from the crossing to the request, at which the pixel is reset, µs.
    pub latency_us: f64,
    /// Refractory period after the reset, µs.
    pub refractory_us: f64,
    /// Events without a crossing, half of them ON, Hz.
    pub spontaneous_hz: f64,
    /// Whether it is dead (never fires).
    pub is_dead: bool,
}

/// Noise with a correlation time: an Ornstein–Uhlenbeck process.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BandNoise {
    /// Standard deviation at white, nominal thresholds.
    pub rms: f64,
    /// Cut-off (−3 dB), Hz.
    pub bandwidth_hz: f64,
    /// The standard deviation goes with the intensity to the power of minus this.
    pub light_exponent: f64,
}

/// Thresholds redrawn at every event, and at random instants between events: noise of the
/// comparison that is not stored in the reference level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThresholdScatter {
    /// Scale of their logistic law at white, nominal thresholds.
    pub scale: f64,
    /// The scale goes with the intensity to the power of minus this.
    pub light_exponent: f64,
    /// How often they are drawn anew between events, Hz.
    pub redrawn_hz: f64,
}

impl PixelModel {
    /// The voltmeter's pixel with these k, for frames that read `white_dn` on white paper.
    #[must_use]
    pub fn from_k(k: Coefficients, white_dn: f64) -> Self {
        const US_PER_S: f64 = 1e6;
        let [k1, k2, k3, k4, k5, k6] = k.k();
        Self {
            gain: k1,
            floor_of_white: k2 / white_dn,
            threshold_on: 1.0,
            threshold_off: 1.0,
            leak_hz: k4 * US_PER_S,
            leak_hz_at_white: k5 * white_dn * US_PER_S,
            leak_hz_per_s: 0.0,
            shot_per_sqrt_s: k3 / white_dn.sqrt() * US_PER_S.sqrt(),
            white_per_sqrt_s: k6 * US_PER_S.sqrt(),
            band: None,
            scatter: None,
            latency_us: 0.0,
            refractory_us: 0.0,
            spontaneous_hz: 0.0,
            is_dead: false,
        }
    }

    /// Standard deviation of the white noise at an intensity over white, thresholds a root second.
    #[must_use]
    pub fn white_noise(&self, intensity: f64) -> f64 {
        let shot = self.shot_per_sqrt_s * intensity.sqrt() / (intensity + self.floor_of_white);
        (if self.shot_per_sqrt_s > 0.0 { shot } else { 0.0 }) + self.white_per_sqrt_s
    }

    /// Whether the same light gives the same events at the same times.
    #[must_use]
    pub fn is_quiet(&self) -> bool {
        self.shot_per_sqrt_s == 0.0
            && self.white_per_sqrt_s == 0.0
            && self.band.is_none_or(|band| band.rms == 0.0)
            && self.scatter.is_none_or(|scatter| scatter.scale == 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_k_of_frames_give_the_same_drift_and_noise_in_units_of_white() {
        let k = Coefficients::RGB2DVS346;
        let white_dn = 180.0;
        let pixel = PixelModel::from_k(k, white_dn);
        let (before, after) = (60.0_f32, 61.0_f32);
        let motion = k.motion(before, after, 1e6);
        let i = 60.5 / white_dn;
        let drift = pixel.gain / (i + pixel.floor_of_white) / white_dn
            + pixel.leak_hz
            + pixel.leak_hz_at_white * i;
        assert!((motion.drift_per_us * 1e6 / drift - 1.0).abs() < 1e-9);
        let sigma = motion.sigma_per_sqrt_us * 1e3;
        assert!((sigma / pixel.white_noise(i) - 1.0).abs() < 1e-9);
    }
}
