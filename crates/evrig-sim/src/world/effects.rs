//! Effects of the world; each is off unless its table is present.

mod clocks;
mod frames;
mod mechanics;
mod pixel;
mod readout;
mod unlisted;

pub use clocks::{ClockOffset, ClockSkew};
pub use frames::{
    BlackLevel, Defocus, ExposureBlur, Flicker, FrameNoise, Misregistration, MovingShadow,
    RollingShutter, ToneCurve, Vignetting, WhichCamera,
};
pub use mechanics::Vibration;
pub use pixel::{
    Adaptation, BackgroundActivity, DarkCurrent, DeadPixels, FixedPole, HotPixels, JunctionLeak,
    PhotocurrentLeak, PhotoreceptorBandwidth, PixelLatency, ShotNoise, TemperatureDrift,
    ThresholdAsymmetry, ThresholdMismatch, WorldRefractoryPeriod,
};
pub use readout::{ApsCoupling, EventDrop, ReadoutSaturation, RowReadout, StampJitter};
pub use unlisted::{SlewLimit, SupportFilter, ThresholdFatigue};

use evrig_core::effect_id::EffectId;
use evrig_core::geometry::Rectangle;
use serde::{Deserialize, Serialize};

macro_rules! effects {
    ($($(#[$doc:meta])* $field:ident: $kind:ty,)*) => {
        /// The active effects, each under its id; `None` is off.
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct WorldEffects {
            /// The rectangle of DAVIS pixels to which the pixels' own effects are limited.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub region: Option<Rectangle>,
            $($(#[$doc])* #[serde(skip_serializing_if = "Option::is_none")] pub $field: Option<$kind>,)*
        }

        impl WorldEffects {
            /// The keys of effects in a description.
            pub const KEYS: &'static [&'static str] = &[$(stringify!($field),)*];

            /// The keys of the active effects.
            #[must_use]
            pub fn keys_on(&self) -> Vec<&'static str> {
                let mut on = Vec::new();
                $(if self.$field.is_some() { on.push(stringify!($field)); })*
                on
            }
        }
    };
}

effects! {
    /// See [`PhotoreceptorBandwidth`].
    photoreceptor_bandwidth: PhotoreceptorBandwidth,
    /// See [`FixedPole`].
    fixed_pole: FixedPole,
    /// See [`WorldRefractoryPeriod`].
    refractory_period: WorldRefractoryPeriod,
    /// See [`ThresholdMismatch`].
    threshold_mismatch: ThresholdMismatch,
    /// See [`ThresholdAsymmetry`].
    threshold_asymmetry: ThresholdAsymmetry,
    /// See [`JunctionLeak`].
    junction_leak: JunctionLeak,
    /// See [`PhotocurrentLeak`].
    photocurrent_leak: PhotocurrentLeak,
    /// See [`ShotNoise`].
    shot_noise: ShotNoise,
    /// See [`BackgroundActivity`].
    background_activity: BackgroundActivity,
    /// See [`HotPixels`].
    hot_pixels: HotPixels,
    /// See [`DeadPixels`].
    dead_pixels: DeadPixels,
    /// See [`PixelLatency`].
    pixel_latency: PixelLatency,
    /// See [`Adaptation`].
    adaptation: Adaptation,
    /// See [`DarkCurrent`].
    dark_current: DarkCurrent,
    /// See [`TemperatureDrift`].
    temperature_drift: TemperatureDrift,
    /// See [`ReadoutSaturation`].
    readout_saturation: ReadoutSaturation,
    /// See [`RowReadout`].
    row_readout: RowReadout,
    /// See [`EventDrop`].
    event_drop: EventDrop,
    /// See [`StampJitter`].
    stamp_jitter: StampJitter,
    /// See [`ApsCoupling`].
    aps_coupling: ApsCoupling,
    /// See [`ClockOffset`].
    clock_offset: ClockOffset,
    /// See [`ClockSkew`].
    clock_skew: ClockSkew,
    /// See [`ExposureBlur`].
    exposure_blur: ExposureBlur,
    /// See [`RollingShutter`].
    rolling_shutter: RollingShutter,
    /// See [`BlackLevel`].
    black_level: BlackLevel,
    /// See [`ToneCurve`].
    tone_curve: ToneCurve,
    /// See [`FrameNoise`].
    frame_noise: FrameNoise,
    /// See [`Defocus`].
    defocus: Defocus,
    /// See [`Vignetting`].
    vignetting: Vignetting,
    /// See [`Misregistration`].
    misregistration: Misregistration,
    /// See [`Flicker`].
    flicker: Flicker,
    /// See [`MovingShadow`].
    moving_shadow: MovingShadow,
    /// See [`Vibration`].
    vibration: Vibration,
    /// See [`SupportFilter`]; not an [`EffectId`].
    support_filter: SupportFilter,
    /// See [`SlewLimit`]; not an [`EffectId`].
    slew_limit: SlewLimit,
    /// See [`ThresholdFatigue`]; not an [`EffectId`].
    threshold_fatigue: ThresholdFatigue,
}

impl WorldEffects {
    /// The active effects that have an [`EffectId`].
    #[must_use]
    pub fn on(&self) -> Vec<EffectId> {
        self.keys_on().into_iter().filter_map(|key| key.parse().ok()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The frames' interpolation is a model's fault; no camera can show it.
    const NOT_PHYSICAL: &[EffectId] = &[EffectId::FrameInterpolation];

    #[test]
    fn every_named_effect_that_a_camera_can_show_is_a_table_of_the_world() {
        for effect in EffectId::ALL {
            let is_here = WorldEffects::KEYS.contains(&effect.as_str());
            assert_eq!(is_here, !NOT_PHYSICAL.contains(effect), "{effect}");
        }
    }

    #[test]
    fn every_parameter_of_the_table_is_read_under_its_key() {
        for effect in EffectId::ALL.iter().filter(|effect| !NOT_PHYSICAL.contains(effect)) {
            let values: Vec<_> =
                effect.parameters().iter().map(|key| format!("{key} = 1")).collect();
            let text = format!("{effect} = {{ {} }}", values.join(", "));
            let effects: WorldEffects =
                toml::from_str(&text).unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!(effects.on(), [*effect]);
        }
    }

    #[test]
    fn at_least_three_effects_are_in_no_table() {
        let unnamed = WorldEffects::KEYS.iter().filter(|key| key.parse::<EffectId>().is_err());
        assert!(unnamed.count() >= 3);
    }
}
