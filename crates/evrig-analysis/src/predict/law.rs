//! The law of a pixel's comparator: a smooth hazard of both polarities.
//!
//! With the change of the signal since the reference level, `u`, in thresholds and its speed `v`,
//! the hazard of a polarity is
//!
//! ```text
//! (1 / s) logistic((u - 1) / s) * nu softplus(v / nu)
//! ```
//!
//! an escape rate with a speed term (Plesser and Gerstner, Neural Comput. 12, 2000): for a steady
//! ramp it is the hazard of a logistic threshold of scale `s`, and where the signal rests or turns
//! the noise's own speed `nu` carries it over the threshold, as in Rice's formula (1945). It has no
//! discontinuity where the signal has an extremum.

pub(crate) use super::softplus::{logistic, softplus};

/// Standard deviation of a logistic distribution over its scale: pi / sqrt(3).
pub(crate) const LOGISTIC_SD: f64 = 1.813_799_364_234_217_8;

/// Path of the signal, in thresholds, over which the error of the known signal decorrelates.
const ERROR_PATH: f64 = 2.0;

/// Decorrelated share of that error after a path of one threshold: 1 - exp(-1/4).
const ERROR_AT_THRESHOLD: f64 = 0.221_199_216_928_595_1;

/// When a pixel fires. Contrast in natural logarithms of intensity, time in seconds; pairs are ON,
/// OFF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ComparatorLaw {
    /// Thresholds, log intensity.
    pub(crate) theta: [f64; 2],
    /// Drift of the signal towards ON, log intensity per second.
    pub(crate) leak_per_s: f64,
    /// Logistic scale of the noise at white after a path of one threshold, log intensity.
    pub(crate) noise: f64,
    /// The noise is proportional to intensity to the power of minus this.
    pub(crate) noise_exponent: f64,
    /// Share of the noise that remains where the signal has not moved.
    pub(crate) rest_share: f64,
    /// Speed of the noise over its scale, per second.
    pub(crate) noise_rate_hz: f64,
    /// Share of the noise's variance that is stored in the reference level.
    pub(crate) stored_share: f64,
    /// Rates of events that no crossing causes, Hz.
    pub(crate) background_hz: [f64; 2],
    /// Share of those that reset the reference level.
    pub(crate) background_reset: f64,
    /// Refractory period, seconds.
    pub(crate) refractory_s: f64,
    /// Logistic scale of its end, seconds.
    pub(crate) onset_s: f64,
    /// Moment at which the reference level is taken, in refractory periods after the event.
    pub(crate) retake: f64,
    /// Standard deviation of the time stamps, seconds.
    pub(crate) jitter_s: f64,
    /// Standard deviation of band-limited noise of the signal at white, log intensity.
    pub(crate) shot_rms: f64,
    /// Bandwidth of that noise, Hz.
    pub(crate) shot_hz: f64,
    /// Share of events that are lost behind the pixel.
    pub(crate) loss: f64,
    /// Rate of the bursts that follow frames over that of all pixels.
    pub(crate) burst_factor: f64,
}

impl Default for ComparatorLaw {
    fn default() -> Self {
        Self {
            theta: [0.25; 2],
            leak_per_s: 0.0,
            noise: 0.015,
            noise_exponent: 0.3,
            rest_share: 0.4,
            noise_rate_hz: 60.0,
            stored_share: 0.2,
            background_hz: [0.01; 2],
            background_reset: 1.0,
            refractory_s: 0.0,
            onset_s: 0.0,
            retake: 1.0,
            jitter_s: 0.0,
            shot_rms: 0.0,
            shot_hz: 0.0,
            loss: 0.0,
            burst_factor: 0.0,
        }
    }
}

impl ComparatorLaw {
    /// Factor of the noise at a log intensity relative to white.
    pub(crate) fn darkness(&self, level: f64) -> f64 {
        (-self.noise_exponent * level.clamp(-12.0, 3.0)).exp()
    }

    /// Squared factor of the noise after a path of the signal in thresholds; 1 after one threshold.
    pub(crate) fn path_share2(&self, path: f64) -> f64 {
        let decorrelated = 1.0 - (-(path / ERROR_PATH).powi(2)).exp();
        let at_rest = self.rest_share * self.rest_share;
        at_rest + (1.0 - at_rest) * decorrelated / ERROR_AT_THRESHOLD
    }

    /// Largest value of [`Self::path_share2`].
    pub(crate) fn max_path_share2(&self) -> f64 {
        self.path_share2(1e3).max(1.0)
    }
}
