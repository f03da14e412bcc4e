//! Identifiers of physical effects, shared by simulated world, generators and diagnosis.
//!
//! How an effect acts in the simulated world, in a generator and in the residuals is implemented in
//! three crates that share only this table. Identifiers and parameter keys are stable: sealed
//! trials and `diagnosis.json` contain them. Add some, rename none.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The part of the chain from light to file to which an effect belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EffectGroup {
    /// Inside an event pixel.
    Pixel,
    /// Between the pixels and the file: arbiter, stamps, transport.
    Readout,
    /// Between the clocks of the cameras.
    Clocks,
    /// The frame camera, the optics of either camera, the light.
    Frames,
    /// The arm.
    Mechanics,
}

macro_rules! effects {
    ($($(#[$doc:meta])* $variant:ident, $id:literal, $group:ident, $name:literal, [$($parameter:literal),*];)*) => {
        /// One physical mechanism that a model may or may not have.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        pub enum EffectId {
            $($(#[$doc])* #[serde(rename = $id)] $variant,)*
        }

        impl EffectId {
            /// Every effect, in the order of the signal chain.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// The id as files write it.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self { $(Self::$variant => $id,)* }
            }

            /// The name for people.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// Its part of the signal chain.
            #[must_use]
            pub const fn group(self) -> EffectGroup {
                match self { $(Self::$variant => EffectGroup::$group,)* }
            }

            /// The keys of its parameters, each with its unit in the key.
            #[must_use]
            pub const fn parameters(self) -> &'static [&'static str] {
                match self { $(Self::$variant => &[$($parameter),*],)* }
            }
        }
    };
}

effects! {
    /// The photoreceptor's bandwidth decreases with intensity.
    PhotoreceptorBandwidth, "photoreceptor_bandwidth", Pixel, "Photoreceptor bandwidth", ["cutoff_hz_at_white", "order"];
    /// A low-pass pole after the photoreceptor, independent of intensity.
    FixedPole, "fixed_pole", Pixel, "Fixed pole", ["cutoff_hz"];
    /// The pixel emits no event for some time after each event.
    RefractoryPeriod, "refractory_period", Pixel, "Refractory period", ["refractory_us"];
    /// Contrast thresholds vary between pixels.
    ThresholdMismatch, "threshold_mismatch", Pixel, "Threshold mismatch", ["sigma_relative"];
    /// The ON and OFF thresholds differ.
    ThresholdAsymmetry, "threshold_asymmetry", Pixel, "Threshold asymmetry", ["on_off_ratio"];
    /// ON events at a rate independent of intensity.
    JunctionLeak, "junction_leak", Pixel, "Junction leak", ["rate_hz"];
    /// ON events at a rate proportional to intensity.
    PhotocurrentLeak, "photocurrent_leak", Pixel, "Photocurrent leak", ["rate_hz_at_white"];
    /// Band-limited noise of the photoreceptor.
    ShotNoise, "shot_noise", Pixel, "Shot noise", ["rms_thresholds", "bandwidth_hz"];
    /// Random events without memory (a Poisson process).
    BackgroundActivity, "background_activity", Pixel, "Background activity", ["rate_hz"];
    /// Pixels that fire without a stimulus.
    HotPixels, "hot_pixels", Pixel, "Hot pixels", ["fraction"];
    /// Pixels that never fire.
    DeadPixels, "dead_pixels", Pixel, "Dead pixels", ["count"];
    /// Delay from the threshold crossing to the readout request.
    PixelLatency, "pixel_latency", Pixel, "Pixel latency", ["latency_us"];
    /// Part of the signal decays slowly (high-pass).
    Adaptation, "adaptation", Pixel, "Adaptation", ["time_constant_s", "fraction"];
    /// Photodiode current without light.
    DarkCurrent, "dark_current", Pixel, "Dark current", ["fraction_of_white"];
    /// The leak grows while the chip warms.
    TemperatureDrift, "temperature_drift", Pixel, "Temperature drift", ["rate_hz_per_s"];
    /// The bus limits the event rate.
    ReadoutSaturation, "readout_saturation", Readout, "Readout saturation", ["max_events_per_s"];
    /// Pending events of a row are read together.
    RowReadout, "row_readout", Readout, "Row readout", ["row_us"];
    /// Events are lost in readout.
    EventDrop, "event_drop", Readout, "Event drop", ["fraction"];
    /// Timestamps scatter around the event's time.
    StampJitter, "stamp_jitter", Readout, "Stamp jitter", ["sigma_us"];
    /// Frame readout triggers spurious events.
    ApsCoupling, "aps_coupling", Readout, "APS coupling", ["events_fraction", "delay_us", "row_us"];
    /// The event camera's timestamps lag the frame camera's.
    ClockOffset, "clock_offset", Clocks, "Clock offset", ["offset_us"];
    /// The event camera's clock runs fast.
    ClockSkew, "clock_skew", Clocks, "Clock skew", ["skew_ppm"];
    /// The exposure is longer than stated.
    ExposureBlur, "exposure_blur", Frames, "Exposure blur", ["exposure_us"];
    /// The row time differs from the stated one.
    RollingShutter, "rolling_shutter", Frames, "Rolling shutter", ["row_us"];
    /// The signal between two frames is not linear.
    FrameInterpolation, "frame_interpolation", Frames, "Frame interpolation", ["share"];
    /// The frames' black level differs from the stated one.
    BlackLevel, "black_level", Frames, "Black level", ["offset_dn"];
    /// The frames are not linear in light.
    ToneCurve, "tone_curve", Frames, "Tone curve", ["gamma"];
    /// The frame noise exceeds the stated one.
    FrameNoise, "frame_noise", Frames, "Frame noise", ["sigma_dn"];
    /// A lens is out of focus.
    Defocus, "defocus", Frames, "Defocus", ["sigma_px"];
    /// Intensity falls off towards the corners.
    Vignetting, "vignetting", Frames, "Vignetting", ["corner_loss"];
    /// The event camera's registration differs from the stated one.
    Misregistration, "misregistration", Frames, "Misregistration", ["shift_x_px", "shift_y_px", "rotation_deg", "scale"];
    /// The illumination flickers.
    Flicker, "flicker", Frames, "Flicker", ["frequency_hz", "depth"];
    /// A shadow crosses the target.
    MovingShadow, "moving_shadow", Frames, "Moving shadow", ["depth"];
    /// The arm vibrates while it moves.
    Vibration, "vibration", Mechanics, "Vibration", ["frequency_hz", "amplitude_mm"];
}

/// An unknown effect name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no effect is called `{got}`{hint}")]
pub struct UnknownEffect {
    got: String,
    hint: String,
}

impl FromStr for EffectId {
    type Err = UnknownEffect;

    fn from_str(text: &str) -> Result<Self, UnknownEffect> {
        let found = Self::ALL.iter().copied().find(|effect| effect.as_str() == text);
        found.ok_or_else(|| {
            let likeness = |effect: &Self| strsim::jaro_winkler(text, effect.as_str());
            let nearest = Self::ALL.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
            let hint = nearest.filter(|effect| likeness(effect) > 0.8);
            let hint = hint.map_or(String::new(), |effect| format!("; did you mean `{effect}`?"));
            UnknownEffect { got: text.to_owned(), hint }
        })
    }
}

impl fmt::Display for EffectId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_id_reads_back_from_text_and_from_json() {
        for effect in EffectId::ALL {
            assert_eq!(effect.as_str().parse(), Ok(*effect));
            let json = serde_json::to_string(effect).unwrap();
            assert_eq!(json, format!("\"{effect}\""));
            assert_eq!(serde_json::from_str::<EffectId>(&json).unwrap(), *effect);
        }
    }

    #[test]
    fn ids_are_unique_and_every_effect_has_a_parameter() {
        let ids: BTreeSet<_> = EffectId::ALL.iter().map(|effect| effect.as_str()).collect();
        assert_eq!(ids.len(), EffectId::ALL.len());
        assert!(EffectId::ALL.iter().all(|effect| !effect.parameters().is_empty()));
    }

    #[test]
    fn a_slip_of_the_pen_gets_a_hint() {
        let error = "refractory_time".parse::<EffectId>().unwrap_err();
        assert!(error.to_string().contains("`refractory_period`"), "{error}");
        assert!(!"xyz".parse::<EffectId>().unwrap_err().to_string().contains("mean"));
    }
}
