//! What every effect states and how it acts on signal, pixel and events.

use super::pixel_site::{PixelSite, RecordingContext, SiteSignal, stream_of};
use super::region::Region;
use crate::pixel_model::PixelModel;
use crate::random::{CounterRng, RandomSource};
use evrig_core::effect_id::EffectId;
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use serde::{Deserialize, Serialize};

/// Stage of the signal path, from the frames to the time stamps, at which an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SignalStage {
    /// Errors of the frames.
    Frames,
    /// Illumination of the target.
    Light,
    /// Direction and sharpness of a pixel's view.
    Optics,
    /// Intensity to photocurrent.
    Photodiode,
    /// Photocurrent to logarithmic signal.
    Photoreceptor,
    /// Reference level stored at the last event.
    Memory,
    /// Contrast thresholds.
    Thresholds,
    /// Change of the voltage without change of the intensity.
    Drift,
    /// Random change of the voltage.
    Noise,
    /// Threshold crossing to request.
    Emission,
    /// Request to time stamp.
    Readout,
    /// Time stamps.
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

/// A camera's readout: which pixels were simulated, over which time, in which recording.
#[derive(Debug, Clone, Copy)]
pub struct ReadoutContext<'a> {
    /// Columns and rows.
    pub size: Size,
    /// First and last instant of the signal, µs.
    pub window_us: [i64; 2],
    /// Times of the recording's frames.
    pub context: &'a RecordingContext,
    /// The pixels that the effect acts on.
    pub region: Region,
    /// The pixels that were simulated, as column and row.
    pub pixels: &'a [(u16, u16)],
    pub(crate) source: RandomSource,
}

impl ReadoutContext<'_> {
    /// The random numbers of an effect for one event; they do not depend on other events.
    pub(super) fn draws(&self, id: EffectId, event: Event) -> CounterRng {
        /// An odd number that spreads times over all bits (2^64 over the golden ratio).
        const TIME_SPREAD: u64 = 0x9E37_79B9_7F4A_7C15;
        let time = (event.t as u64).wrapping_mul(TIME_SPREAD);
        self.source.draws(self.size.index(event.x, event.y) as u32, stream_of(id) ^ (time >> 1))
    }

    /// Share of the camera's pixels that were simulated; the load of the bus is in proportion.
    pub(super) fn share(&self) -> f64 {
        self.pixels.len() as f64 / self.size.n_pixels() as f64
    }

    /// Replaces the events within the region by the result of `change`, and sorts.
    pub(super) fn change(
        &self,
        events: &mut Events,
        change: impl FnOnce(Vec<Event>) -> Vec<Event>,
    ) {
        let is_inside = |event: &Event| self.region.contains(event.x, event.y);
        let (inside, outside): (Vec<Event>, Vec<Event>) =
            events.as_slice().iter().partition(is_inside);
        let mut all = change(inside);
        all.extend(outside);
        all.sort_by_key(|event| (event.t, event.y, event.x));
        *events = all.into_iter().collect();
    }
}

/// What an effect states about itself.
pub trait EffectDescription {
    /// The stage at which it acts.
    fn stage(&self) -> SignalStage;

    /// The law, as it is printed in a report.
    fn equation(&self) -> &'static str;

    /// Its parameters with their ranges; first those of [`EffectId::parameters`].
    fn parameters(&self) -> Vec<EffectParameter>;
}

/// How an effect acts. A hook does nothing unless the effect overrides it.
pub trait EffectModel: EffectDescription {
    /// Data of the recording that the effect needs and that are missing.
    fn missing_input(&self, _context: &RecordingContext) -> Option<&'static str> {
        None
    }

    /// The place of the drive whose signal the pixel nominally at `place` receives, pixels.
    fn drive_place(&self, _site: &PixelSite<'_>, place: [f64; 2]) -> [f64; 2] {
        place
    }

    /// Delay of the pixel's signal behind the drive, µs.
    fn lag_us(&self, _site: &PixelSite<'_>) -> f64 {
        0.0
    }

    /// Changes the log-intensity signal.
    fn apply_to_signal(&self, _site: &PixelSite<'_>, _signal: &mut SiteSignal<'_>) {}

    /// Changes the pixel.
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, _pixel: &mut PixelModel) {}

    /// Changes the events of the camera, in ascending time before and after.
    fn apply_to_events(&self, _camera: &ReadoutContext<'_>, _events: &mut Events) {}
}

/// Defines an effect: its name, stage and equation, and each parameter with its range.
macro_rules! effect {
    (
        $(#[$doc:meta])*
        $name:ident, $stage:ident, $equation:literal {
            $($(#[$field_doc:meta])* $field:ident: $low:literal to $high:literal,)*
        }
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: f64,)*
        }

        impl $crate::effect::model::EffectDescription for $name {
            fn stage(&self) -> $crate::effect::model::SignalStage {
                $crate::effect::model::SignalStage::$stage
            }

            fn equation(&self) -> &'static str {
                $equation
            }

            fn parameters(&self) -> Vec<$crate::effect::model::EffectParameter> {
                vec![$($crate::effect::model::EffectParameter {
                    key: stringify!($field),
                    value: self.$field,
                    low: $low,
                    high: $high,
                },)*]
            }
        }
    };
}
