//! An event camera with the constants that a diagnosis estimated.

use super::parameters::{ForwardError, ForwardParameters, MAX_EVENT_RATE_HZ};
use super::simulator::{ForwardSimulator, SimulatedEvents};
use crate::effect::RecordingContext;
use crate::pixel_model::{BandNoise, PixelModel, ThresholdScatter};
use evrig_core::drive::Drive;
use serde::{Deserialize, Serialize};

/// A camera with all its constants. Intensity is relative to white and time in microseconds, so it
/// can be simulated on the drive of any recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraConstants {
    /// Nominal thresholds, leak and effects.
    pub generator: ForwardParameters,
    /// The threshold of ON over the nominal one; that of OFF is its inverse. Above 0.
    pub on_over_nominal: f64,
    /// Noise that is stored in the reference level, unless an effect sets it.
    pub noise: BandNoise,
    /// Noise of the comparison, which is not stored, unless an effect sets it.
    pub scatter: ThresholdScatter,
    /// Rate of events without a crossing, both polarities, Hz; effects add to it.
    pub background_hz: f64,
}

impl CameraConstants {
    /// The events of some pixels in a window of the drive's clock, as [`ForwardSimulator::run`]
    /// gives them.
    ///
    /// # Errors
    /// A constant out of range, an effect without its input, an invalid window or pixel, or an
    /// unbounded event rate.
    pub fn events(
        &self,
        drive: &dyn Drive,
        pixels: &[(u16, u16)],
        window_us: [i64; 2],
        context: RecordingContext,
        seed: u64,
    ) -> Result<SimulatedEvents, ForwardError> {
        self.check()?;
        let forward = ForwardSimulator::new(self.generator.clone(), context)?;
        let adjust = |_: u16, _: u16, pixel: &mut PixelModel| self.adjust(pixel);
        forward.run_with(drive, pixels, window_us, seed, &adjust)
    }

    /// Checks the ranges of all constants.
    ///
    /// # Errors
    /// The first that is out of range.
    pub fn check(&self) -> Result<(), ForwardError> {
        let most = f64::from(MAX_EVENT_RATE_HZ);
        for (key, value, low, high) in [
            ("on_over_nominal", self.on_over_nominal, 0.01, 100.0),
            ("noise.rms", self.noise.rms, 0.0, 100.0),
            ("noise.bandwidth_hz", self.noise.bandwidth_hz, 0.01, 1e6),
            ("noise.light_exponent", self.noise.light_exponent, -10.0, 10.0),
            ("scatter.scale", self.scatter.scale, 0.0, 100.0),
            ("scatter.light_exponent", self.scatter.light_exponent, -10.0, 10.0),
            ("scatter.redrawn_hz", self.scatter.redrawn_hz, 0.0, 1e6),
            ("background_hz", self.background_hz, 0.0, most),
        ] {
            if !(low..=high).contains(&value) {
                return Err(ForwardError::Camera { key, value, low, high });
            }
        }
        Ok(())
    }

    fn adjust(&self, pixel: &mut PixelModel) {
        let half = self.on_over_nominal;
        pixel.threshold_on *= half;
        pixel.threshold_off /= half;
        // Leaks are stated in thresholds for ON, the generator's in nominal ones.
        pixel.leak_hz *= half;
        pixel.leak_hz_at_white *= half;
        pixel.leak_hz_per_s *= half;
        match &mut pixel.band {
            // Shot noise that was named; it grows towards the dark as the other noise does.
            Some(named) => named.light_exponent = self.noise.light_exponent,
            none => (*none, pixel.scatter) = (Some(self.noise), Some(self.scatter)),
        }
        pixel.spontaneous_hz += self.background_hz;
    }
}
