//! The effects of the library, one file each.

use super::error::EffectError;
use super::model::{EffectModel, EffectParameter};
use evrig_core::effect_id::EffectId;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

macro_rules! effects {
    ($($module:ident::$name:ident = $id:literal;)*) => {
        $(mod $module; pub use $module::$name;)*

        /// One effect with its parameters.
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        pub enum Effect {
            $(#[doc = concat!("See [`", stringify!($name), "`].")] #[serde(rename = $id)] $name($name),)*
        }

        $(impl From<$name> for Effect {
            fn from(effect: $name) -> Self {
                Self::$name(effect)
            }
        })*

        impl Effect {
            /// Which it is.
            #[must_use]
            pub const fn id(&self) -> EffectId {
                match self { $(Self::$name(_) => EffectId::$name,)* }
            }

            /// How it acts.
            #[must_use]
            pub const fn model(&self) -> &dyn EffectModel {
                match self { $(Self::$name(effect) => effect,)* }
            }
        }
    };
}

effects! {
    photoreceptor_bandwidth::PhotoreceptorBandwidth = "photoreceptor_bandwidth";
    fixed_pole::FixedPole = "fixed_pole";
    refractory_period::RefractoryPeriod = "refractory_period";
    threshold_mismatch::ThresholdMismatch = "threshold_mismatch";
    threshold_asymmetry::ThresholdAsymmetry = "threshold_asymmetry";
    junction_leak::JunctionLeak = "junction_leak";
    photocurrent_leak::PhotocurrentLeak = "photocurrent_leak";
    shot_noise::ShotNoise = "shot_noise";
    background_activity::BackgroundActivity = "background_activity";
    hot_pixels::HotPixels = "hot_pixels";
    dead_pixels::DeadPixels = "dead_pixels";
    pixel_latency::PixelLatency = "pixel_latency";
    adaptation::Adaptation = "adaptation";
    dark_current::DarkCurrent = "dark_current";
    temperature_drift::TemperatureDrift = "temperature_drift";
    readout_saturation::ReadoutSaturation = "readout_saturation";
    row_readout::RowReadout = "row_readout";
    event_drop::EventDrop = "event_drop";
    stamp_jitter::StampJitter = "stamp_jitter";
    aps_coupling::ApsCoupling = "aps_coupling";
    clock_offset::ClockOffset = "clock_offset";
    clock_skew::ClockSkew = "clock_skew";
    exposure_blur::ExposureBlur = "exposure_blur";
    rolling_shutter::RollingShutter = "rolling_shutter";
    frame_interpolation::FrameInterpolation = "frame_interpolation";
    black_level::BlackLevel = "black_level";
    tone_curve::ToneCurve = "tone_curve";
    frame_noise::FrameNoise = "frame_noise";
    defocus::Defocus = "defocus";
    vignetting::Vignetting = "vignetting";
    misregistration::Misregistration = "misregistration";
    flicker::Flicker = "flicker";
    moving_shadow::MovingShadow = "moving_shadow";
    vibration::Vibration = "vibration";
}

impl Effect {
    /// The effect of that id with these parameters.
    ///
    /// # Errors
    /// A parameter that is missing, unknown or out of range.
    pub fn from_parameters(id: EffectId, parameters: &[(&str, f64)]) -> Result<Self, EffectError> {
        let table = parameters.iter().map(|&(key, value)| (key.to_owned(), value.into()));
        let effect = Self::from_table(id, table.collect())?;
        effect.check()?;
        Ok(effect)
    }

    /// The effect of that id with the parameters of a table, their ranges not yet checked.
    pub(super) fn from_table(id: EffectId, table: Map<String, Value>) -> Result<Self, EffectError> {
        let tagged = Value::Object(Map::from_iter([(id.to_string(), Value::Object(table))]));
        serde_json::from_value(tagged)
            .map_err(|error| EffectError::Unreadable { id, reason: error.to_string() })
    }

    /// Refuses parameters outside their ranges.
    ///
    /// # Errors
    /// The first that is out of range.
    pub fn check(&self) -> Result<(), EffectError> {
        for EffectParameter { key, value, low, high } in self.model().parameters() {
            if !(low..=high).contains(&value) {
                return Err(EffectError::OutOfRange { id: self.id(), key, value, low, high });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An effect of every name, of ordinary strength.
    fn every() -> Vec<Effect> {
        let ordinary = |parameter: &&'static str| match *parameter {
            "order" | "on_off_ratio" | "gamma" | "scale" => (*parameter, 1.0),
            "cutoff_hz" | "cutoff_hz_at_white" | "bandwidth_hz" => (*parameter, 50.0),
            "max_events_per_s" => (*parameter, 1e6),
            "count" => (*parameter, 3.0),
            _ => (*parameter, 0.1),
        };
        let make = |id: &EffectId| {
            let parameters: Vec<_> = id.parameters().iter().map(ordinary).collect();
            Effect::from_parameters(*id, &parameters).unwrap()
        };
        EffectId::ALL.iter().map(make).collect()
    }

    #[test]
    fn every_id_has_an_effect_whose_parameters_have_its_keys() {
        for (effect, id) in every().iter().zip(EffectId::ALL) {
            assert_eq!(effect.id(), *id);
            let keys: Vec<&str> = effect.model().parameters().iter().map(|p| p.key).collect();
            assert_eq!(&keys[..id.parameters().len()], id.parameters(), "{id}");
            assert!(!effect.model().equation().is_empty(), "{id}");
        }
    }

    #[test]
    fn every_parameter_is_refused_outside_its_range_by_name() {
        for effect in every() {
            for p in effect.model().parameters() {
                assert!((p.low..=p.high).contains(&p.value), "{}: {}", effect.id(), p.key);
                let keys = effect.id().parameters();
                if !keys.contains(&p.key) {
                    continue;
                }
                let with = |value: f64| {
                    let others = effect.model().parameters();
                    let others = others.iter().filter(|o| keys.contains(&o.key));
                    let all: Vec<(&str, f64)> = others
                        .map(|o| (o.key, if o.key == p.key { value } else { o.value }))
                        .collect();
                    Effect::from_parameters(effect.id(), &all)
                };
                for value in [p.low - 1.0, p.high * 1.01 + 1.0, f64::NAN] {
                    let error = with(value).unwrap_err().to_string();
                    assert!(error.contains(effect.id().as_str()), "{error}");
                }
            }
        }
    }
}
