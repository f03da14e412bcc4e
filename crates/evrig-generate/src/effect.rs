//! Physical effects: how each acts in a generator, one a file.
//!
//! An effect enters somewhere on the way from light to file ([`SignalStage`]). Those before the
//! comparator change the light signal of a pixel; those of the comparator change its
//! [`PixelModel`]; those behind it change the events. Effects of the frame camera are what the
//! frames got wrong, so here they are taken out of the drive again: a generator with
//! `tone_curve` makes the events of the light that the frames bent.
//!
//! Parameters have the keys of [`EffectId::parameters`]; what else an effect can be told has a
//! default and stands in its own file.

mod error;
mod low_pass;
mod region;
mod set;
mod site;
#[cfg(test)]
mod trial;

pub use error::EffectError;
pub use region::Region;
pub use set::{AppliedEffect, EffectSet};
use site::stream_of;
pub use site::{PixelSignal, PixelSite, RecordingContext};

use super::forward::PixelModel;
use crate::random::{CounterRng, RandomSource};
use evrig_core::effect_id::EffectId;
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use serde::{Deserialize, Serialize};

/// Where an effect enters on the way from light to file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SignalStage {
    /// What the frames got wrong of the light.
    Frames,
    /// The light that falls on the print.
    PixelSignal,
    /// Where and how sharply the pixel looks.
    Optics,
    /// From light to current.
    Photodiode,
    /// From light to the logarithmic signal.
    Photoreceptor,
    /// What the pixel remembers.
    Memory,
    /// How much change makes an event.
    Thresholds,
    /// What changes without light changing.
    Drift,
    /// What changes at random.
    Noise,
    /// From the crossing to the request.
    Emission,
    /// From the request to the stamp.
    Readout,
    /// The stamp itself.
    Stamps,
}

/// A parameter's value and the range in which the effect is defined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectParameter {
    /// Its key, with the unit.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
}

/// A parameter in its range.
const fn parameter(key: &'static str, value: f64, low: f64, high: f64) -> EffectParameter {
    EffectParameter { key, value, low, high }
}

/// What the readout of a whole camera works with.
#[derive(Debug, Clone, Copy)]
pub struct ReadoutContext<'a> {
    /// Columns and rows.
    pub size: Size,
    /// First and last instant of the light, µs.
    pub window_us: [i64; 2],
    /// The recording.
    pub surroundings: &'a RecordingContext,
    /// The pixels that the effect acts on.
    pub region: Region,
    /// The pixels that were run.
    pub pixels: &'a [(u16, u16)],
    pub(crate) source: RandomSource,
}

impl ReadoutContext<'_> {
    /// The draws of an effect for one event: its own, whatever else happens.
    fn draws(&self, id: EffectId, event: Event) -> CounterRng {
        let time = (event.t as u64).wrapping_mul(TIME_SPREAD);
        self.source.draws(self.size.index(event.x, event.y) as u32, stream_of(id) ^ (time >> 1))
    }

    /// The share of the camera's pixels that were run: a bus is as much less loaded.
    fn share(&self) -> f64 {
        self.pixels.len() as f64 / self.size.n_pixels() as f64
    }

    /// Replaces the events within the region by what `change` makes of them, and sorts.
    fn change(&self, events: &mut Events, change: impl FnOnce(Vec<Event>) -> Vec<Event>) {
        let is_inside = |event: &Event| self.region.contains(event.x, event.y);
        let (inside, outside): (Vec<Event>, Vec<Event>) =
            events.as_slice().iter().partition(is_inside);
        let mut all = change(inside);
        all.extend(outside);
        all.sort_by_key(|event| (event.t, event.y, event.x));
        *events = all.into_iter().collect();
    }
}

/// An odd number that spreads times over all bits (2^64 over the golden ratio).
const TIME_SPREAD: u64 = 0x9E37_79B9_7F4A_7C15;

/// How an effect acts. A hook does nothing unless the effect enters there.
pub trait EffectModel {
    /// Where it enters.
    fn enters(&self) -> SignalStage;

    /// The law, as a reader of a report sees it.
    fn equation(&self) -> &'static str;

    /// Its parameters with their ranges; first those of [`EffectId::parameters`].
    fn parameters(&self) -> Vec<EffectParameter>;

    /// What it cannot do without in the recording, if that is missing.
    fn lacks(&self, _surroundings: &RecordingContext) -> Option<&'static str> {
        None
    }

    /// Where a pixel looks that was said to look at `place`.
    fn look(&self, _site: &PixelSite<'_>, place: [f64; 2]) -> [f64; 2] {
        place
    }

    /// How much later than the drive says the pixel sees its light, µs.
    fn lag_us(&self, _site: &PixelSite<'_>) -> f64 {
        0.0
    }

    /// Changes the light signal.
    fn light(&self, _site: &PixelSite<'_>, _light: &mut PixelSignal<'_>) {}

    /// Changes the pixel.
    fn pixel(&self, _site: &PixelSite<'_>, _pixel: &mut PixelModel) {}

    /// Changes the events of the camera, in ascending time before and after.
    fn readout(&self, _bench: &ReadoutContext<'_>, _events: &mut Events) {}
}

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
            pub const fn acts(&self) -> &dyn EffectModel {
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
    /// The effect of that name with these parameters.
    ///
    /// # Errors
    /// A parameter that is missing, unknown or out of range.
    pub fn from_parameters(id: EffectId, parameters: &[(&str, f64)]) -> Result<Self, EffectError> {
        let settings: Vec<String> =
            parameters.iter().map(|(key, value)| format!("{key}={value:?}")).collect();
        let effects = EffectSet::from_words(&[format!("{id}:{}", settings.join(","))])?;
        let unreadable = || EffectError::Unreadable { id, reason: "no parameters".to_owned() };
        effects.iter().next().map(|applied| applied.effect).ok_or_else(unreadable)
    }

    /// Refuses parameters outside their ranges.
    ///
    /// # Errors
    /// The first that is out of range.
    pub fn check(&self) -> Result<(), EffectError> {
        for EffectParameter { key, value, low, high } in self.acts().parameters() {
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
            let keys: Vec<&str> = effect.acts().parameters().iter().map(|p| p.key).collect();
            assert_eq!(&keys[..id.parameters().len()], id.parameters(), "{id}");
            assert!(!effect.acts().equation().is_empty(), "{id}");
        }
    }

    #[test]
    fn every_parameter_is_refused_outside_its_range_by_name() {
        for effect in every() {
            for p in effect.acts().parameters() {
                assert!((p.low..=p.high).contains(&p.value), "{}: {}", effect.id(), p.key);
                let keys = effect.id().parameters();
                if !keys.contains(&p.key) {
                    continue;
                }
                let with = |value: f64| {
                    let others = effect.acts().parameters();
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
