//! The library of effects, one per file.

mod adaptation;
mod aps_coupling;
mod background_activity;
mod black_level;
mod clock_offset;
mod clock_skew;
mod dark_current;
mod dead_pixels;
mod defocus;
mod event_drop;
mod exposure_blur;
mod fixed_pole;
mod flicker;
mod frame_noise;
mod hot_pixels;
mod junction_leak;
mod low_pass;
mod misregistration;
mod model_term;
mod moving_shadow;
mod photocurrent_leak;
mod photoreceptor_bandwidth;
mod pixel_latency;
mod refractory_period;
mod rolling_shutter;
mod shot_noise;
mod sinusoid;
mod stamp_jitter;
mod temperature_drift;
mod threshold_asymmetry;
mod threshold_mismatch;
mod tone_curve;
mod vibration;
mod vignetting;

use crate::diagnose::Evidence;
use evrig_core::effect_id::EffectId;
use model_term::{fixed, linear, log};

pub(crate) use model_term::ModelTerm;

/// An effect that can be named: equation, action on a prediction, competitors.
#[derive(Debug)]
pub struct LibraryEffect {
    /// The effect's id.
    pub id: EffectId,
    /// Its governing equation.
    pub equation: &'static str,
    /// Source of the equation.
    pub source: &'static str,
    /// Its action on a predicted pixel; `None` where it is a constant of the camera, or shows only
    /// in frames or in statistics of all events.
    pub(crate) term: Option<&'static ModelTerm>,
    /// Effects that it can be confused with.
    pub competing: &'static [EffectId],
    /// Effects that no events can separate from it.
    pub inseparable: &'static [EffectId],
    /// Effects with the same law for some of their values.
    pub same_law: &'static [EffectId],
    /// A recording that separates it from its competitors.
    pub separating_recording: &'static str,
    /// Why this evidence cannot test it.
    pub requires: fn(&Evidence) -> Result<(), String>,
    /// The finding in a sentence, from its reported parameters.
    pub describe: fn(&[f64]) -> String,
}

const PLAIN: LibraryEffect = LibraryEffect {
    id: EffectId::RefractoryPeriod,
    equation: "",
    source: "",
    term: None,
    competing: &[],
    inseparable: &[],
    same_law: &[],
    separating_recording: "",
    requires: |_| Ok(()),
    describe: |_| String::new(),
};

/// Every effect that can be named, but for those of the readout. The last four are in no pixel law:
/// only frames can show them.
pub static LIBRARY: [&LibraryEffect; 31] = [
    &photoreceptor_bandwidth::EFFECT,
    &fixed_pole::EFFECT,
    &refractory_period::EFFECT,
    &threshold_mismatch::EFFECT,
    &threshold_asymmetry::EFFECT,
    &junction_leak::EFFECT,
    &photocurrent_leak::EFFECT,
    &shot_noise::EFFECT,
    &background_activity::EFFECT,
    &hot_pixels::EFFECT,
    &dead_pixels::EFFECT,
    &adaptation::EFFECT,
    &dark_current::EFFECT,
    &temperature_drift::EFFECT,
    &event_drop::EFFECT,
    &stamp_jitter::EFFECT,
    &pixel_latency::EFFECT,
    &clock_offset::EFFECT,
    &clock_skew::EFFECT,
    &exposure_blur::EFFECT,
    &rolling_shutter::EFFECT,
    &black_level::EFFECT,
    &defocus::EFFECT,
    &misregistration::EFFECT,
    &flicker::EFFECT,
    &vibration::EFFECT,
    &aps_coupling::EFFECT,
    &tone_curve::EFFECT,
    &vignetting::EFFECT,
    &frame_noise::EFFECT,
    &moving_shadow::EFFECT,
];

/// An effect of the library.
pub(crate) fn library_effect(id: EffectId) -> Option<&'static LibraryEffect> {
    LIBRARY.iter().copied().find(|effect| effect.id == id)
}

/// Whether statistics of all events establish an effect before any light is known, so that no test of
/// the model's fit to that light decides on it: bursts that follow the camera's own frames.
pub(crate) fn is_established_without_light(id: EffectId) -> bool {
    id == EffectId::ApsCoupling
}

fn needs_surroundings(evidence: &Evidence) -> Result<(), String> {
    if evidence.facts.from_scene {
        Ok(())
    } else {
        Err("the light comes from frames of the same sensor, through the same lens".into())
    }
}

fn needs_shown(evidence: &Evidence, id: EffectId, because: &str) -> Result<(), String> {
    if evidence.facts.testable_from_frames.contains(&id) { Ok(()) } else { Err(because.to_owned()) }
}

fn needs_span(evidence: &Evidence, seconds: f64) -> Result<(), String> {
    let has = evidence.seconds();
    if has >= seconds {
        Ok(())
    } else {
        Err(format!("{has:.1} s were recorded; at least {seconds} s are needed"))
    }
}
