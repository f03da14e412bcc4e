//! The parameters of the v2e pixel and the authors' two sets of them.

use crate::limits::{FULL_SCALE_8_BIT_DN, MIN_THRESHOLD};
use crate::parameter_error::{ParameterError, check};
use serde::{Deserialize, Serialize};

/// Parameters of [`crate::GeneratorModel::V2e`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct V2eParameters {
    /// Mean rise of log brightness for an ON event, 0.01..=10.
    pub threshold_on: f64,
    /// Mean fall of log brightness for an OFF event, 0.01..=10.
    pub threshold_off: f64,
    /// Standard deviation of both from pixel to pixel, 0..=1.
    pub threshold_sd: f64,
    /// Cut-off of the photoreceptor's low-pass at full scale, Hz; 0 for none.
    pub cutoff_hz: f64,
    /// Rate of ON events by the leak, Hz.
    pub leak_rate_hz: f64,
    /// Relative standard deviation of the leak from frame to frame.
    pub leak_jitter: f64,
    /// Standard deviation of the leak from pixel to pixel, decades.
    pub leak_spread_decades: f64,
    /// Rate of shot-noise events in the dark, half ON and half OFF, Hz.
    pub shot_noise_rate_hz: f64,
    /// Share of that rate that is left at full scale.
    pub shot_noise_at_full_scale: f64,
    /// Silence after an event, µs.
    pub refractory_us: f64,
    /// Below this brightness (of 255) the scale is linear.
    pub linear_below: f64,
    /// Brightness of white in the frames, DN: 255 for 8 bits, 1023 for 10.
    pub full_scale_dn: f64,
}

impl V2eParameters {
    /// The authors' "clean" set: a little mismatch, nothing else.
    pub const CLEAN: Self = Self {
        threshold_on: 0.2,
        threshold_off: 0.2,
        threshold_sd: 0.02,
        cutoff_hz: 0.0,
        leak_rate_hz: 0.0,
        leak_jitter: 0.0,
        leak_spread_decades: 0.0,
        shot_noise_rate_hz: 0.0,
        shot_noise_at_full_scale: 0.25,
        refractory_us: 0.0,
        linear_below: 20.0,
        full_scale_dn: FULL_SCALE_8_BIT_DN,
    };

    /// The authors' "noisy" set: a dim scene.
    pub const NOISY: Self = Self {
        threshold_sd: 0.05,
        cutoff_hz: 30.0,
        leak_rate_hz: 0.1,
        leak_jitter: 0.1,
        leak_spread_decades: 0.1,
        shot_noise_rate_hz: 5.0,
        ..Self::CLEAN
    };

    /// Refuses what lies outside the ranges, by name.
    ///
    /// # Errors
    /// The first parameter out of range.
    pub fn check(&self) -> Result<(), ParameterError> {
        check("threshold_on", self.threshold_on, MIN_THRESHOLD, 10.0)?;
        check("threshold_off", self.threshold_off, MIN_THRESHOLD, 10.0)?;
        check("threshold_sd", self.threshold_sd, 0.0, 1.0)?;
        check("cutoff_hz", self.cutoff_hz, 0.0, 1e9)?;
        check("leak_rate_hz", self.leak_rate_hz, 0.0, 1e5)?;
        check("leak_jitter", self.leak_jitter, 0.0, 1.0)?;
        check("leak_spread_decades", self.leak_spread_decades, 0.0, 1.0)?;
        check("shot_noise_rate_hz", self.shot_noise_rate_hz, 0.0, 1e5)?;
        check("shot_noise_at_full_scale", self.shot_noise_at_full_scale, 0.0, 10.0)?;
        check("refractory_us", self.refractory_us, 0.0, 1e9)?;
        check("linear_below", self.linear_below, 1.5, 255.0)?;
        check("full_scale_dn", self.full_scale_dn, 1e-3, 1e9)
    }
}
