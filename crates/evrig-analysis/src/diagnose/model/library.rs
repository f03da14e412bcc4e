//! The library of effects, one per file.

mod adaptation;
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
mod frame_interpolation;
mod frame_noise;
mod hot_pixels;
mod junction_leak;
mod misregistration;
mod moving_shadow;
mod photocurrent_leak;
mod photoreceptor_bandwidth;
mod pixel_latency;
mod refractory_period;
mod rolling_shutter;
mod shot_noise;
mod stamp_jitter;
mod temperature_drift;
mod threshold_asymmetry;
mod threshold_mismatch;
mod tone_curve;
mod vibration;
mod vignetting;

use super::nuisance::Nuisance;
use crate::diagnose::{Evidence, Hypothesis, PixelMixture, PixelStratum, PredictedPixel};
use evrig_core::effect_id::EffectId;

/// Where in the signal chain an effect acts; earlier stages first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CandidateStage {
    /// The light in front of the pixel.
    Light,
    /// The photoreceptor.
    Receptor,
    /// A slow drift of the signal.
    Drift,
    /// The pixel law.
    Law,
    /// The clock.
    Clock,
}

impl CandidateStage {
    pub(crate) const ALL: [Self; 5] =
        [Self::Light, Self::Receptor, Self::Drift, Self::Law, Self::Clock];

    /// Stages that do not change the signal.
    pub(crate) const AFTER_SIGNAL: [Self; 2] = [Self::Law, Self::Clock];
}

/// A parameter of an effect.
#[derive(Debug, Clone, Copy)]
pub struct CandidateParameter {
    /// Key with unit.
    pub key: &'static str,
    /// Lower and upper bound.
    pub range: [f64; 2],
    /// Whether its logarithm is fitted.
    pub is_log: bool,
    /// Whether it keeps its starting value.
    pub is_fixed: bool,
    /// Whether it is not reported.
    pub is_hidden: bool,
    /// Finite-difference step in the fitted coordinate.
    pub step: f64,
}

impl CandidateParameter {
    const fn log(key: &'static str, range: [f64; 2]) -> Self {
        Self { key, range, is_log: true, is_fixed: false, is_hidden: false, step: 0.02 }
    }

    const fn linear(key: &'static str, range: [f64; 2], step: f64) -> Self {
        Self { key, range, is_log: false, is_fixed: false, is_hidden: false, step }
    }

    const fn fixed(key: &'static str, range: [f64; 2]) -> Self {
        Self { key, range, is_log: false, is_fixed: true, is_hidden: false, step: 0.0 }
    }

    const fn hidden(self) -> Self {
        Self { is_hidden: true, ..self }
    }

    /// From reported to fitted coordinate.
    #[must_use]
    pub fn to_fitted(&self, value: f64) -> f64 {
        if self.is_log { value.ln() } else { value }
    }

    /// From fitted to reported coordinate.
    #[must_use]
    pub fn from_fitted(&self, value: f64) -> f64 {
        if self.is_log { value.exp() } else { value }
    }

    /// Range in the fitted coordinate.
    #[must_use]
    pub fn fitted_range(&self) -> [f64; 2] {
        self.range.map(|end| self.to_fitted(end))
    }

    /// Finite-difference step in the fitted coordinate.
    #[must_use]
    pub const fn fitted_step(&self) -> f64 {
        self.step
    }
}

/// A nuisance that an effect takes beyond its prior range.
#[derive(Debug, Clone, Copy)]
pub struct FreedNuisance {
    /// The nuisance.
    pub nuisance: Nuisance,
    /// Its range, in the fitted coordinate.
    pub range: [f64; 2],
}

/// Derived parameters by key, from an effect's own.
pub type DerivedParameters = fn(&Evidence, &[f64]) -> Vec<(&'static str, f64)>;

/// An effect of the library: equation, action on a prediction, competitors.
#[derive(Debug)]
pub struct CandidateEffect {
    /// The effect's id.
    pub id: EffectId,
    /// Its governing equation.
    pub equation: &'static str,
    /// Source of the equation.
    pub source: &'static str,
    /// Where it acts.
    pub stage: CandidateStage,
    /// Its own parameters; none for an effect that frees nuisances.
    pub parameters: &'static [CandidateParameter],
    /// Nuisances that it takes beyond their prior range.
    pub freed: &'static [FreedNuisance],
    /// Starting values of its parameters or freed nuisances, in fitted coordinates.
    pub starting_points: fn(&Evidence) -> Vec<Vec<f64>>,
    /// Applies its parameters to a pixel of a stratum.
    pub apply: fn(&[f64], PixelStratum, &mut PredictedPixel<'_>),
    /// The mixture of pixel strata, for an effect that differs between pixels; by its index in a
    /// hypothesis.
    pub mixture: Option<fn(&Hypothesis, usize) -> PixelMixture>,
    /// Reported parameters of an effect that frees nuisances, from a hypothesis's values.
    pub report_freed: fn(&[f64]) -> Vec<f64>,
    /// Derived parameters by key.
    pub derived: DerivedParameters,
    /// Effects that it can be confused with.
    pub competing: &'static [EffectId],
    /// Effects that no events can separate from it.
    pub inseparable: &'static [EffectId],
    /// Effects with the same law for some of their values.
    pub same_law: &'static [EffectId],
    /// Whether it shows only in pixels without events, which tests of events do not see.
    pub acts_on_silent_pixels: bool,
    /// A recording that separates it from its competitors.
    pub separating_recording: &'static str,
    /// Why this evidence cannot test it.
    pub requires: fn(&Evidence) -> Result<(), String>,
    /// The clock offset that goes with its parameters if the clock tie holds in the middle; `None`
    /// for effects without relation to clocks.
    pub offset_us: fn(&Evidence, &[f64]) -> Option<f64>,
    /// Nuisances that can imitate it, with the values from which a fit restarts, in fitted
    /// coordinates.
    pub nuisance_resets: &'static [(Nuisance, f64)],
    /// Increases of log threshold for these restarts: noise events are imitated by low thresholds.
    pub theta_raises: &'static [f64],
    /// Standard error of the reference of its first parameter, in the parameter's unit.
    pub reference_error: fn(&Evidence) -> f64,
    /// Whether the events show its signature, given its parameters; required of a named effect.
    pub has_signature: fn(&Evidence, &[f64]) -> bool,
    /// The finding in a sentence.
    pub describe: fn(&[f64]) -> String,
}

impl CandidateEffect {
    /// Its parameters in reported units by key, from values of its own.
    #[must_use]
    pub fn named_parameters(
        &self,
        evidence: &Evidence,
        values: &[f64],
    ) -> Vec<(&'static str, f64)> {
        let own = self.parameters.iter().zip(values).filter(|(p, _)| !p.is_hidden);
        let own = own.map(|(p, value)| (p.key, *value));
        own.chain((self.derived)(evidence, values)).collect()
    }
}

/// Defaults.
const PLAIN: CandidateEffect = CandidateEffect {
    id: EffectId::RefractoryPeriod,
    equation: "",
    source: "",
    stage: CandidateStage::Law,
    parameters: &[],
    freed: &[],
    starting_points: |_| Vec::new(),
    apply: |_, _, _| {},
    mixture: None,
    report_freed: |_| Vec::new(),
    derived: |_, _| Vec::new(),
    competing: &[],
    inseparable: &[],
    same_law: &[],
    acts_on_silent_pixels: false,
    separating_recording: "",
    requires: |_| Ok(()),
    reference_error: |_| 0.0,
    has_signature: |_, _| true,
    offset_us: |_, _| None,
    nuisance_resets: &[],
    theta_raises: &[0.0],
    describe: |_| String::new(),
};

/// Every effect that can be named, but for those of the sensor-wide statistics. The last four are
/// in no pixel law: only frames can show them.
pub static LIBRARY: [&CandidateEffect; 31] = [
    &photoreceptor_bandwidth::CANDIDATE,
    &fixed_pole::CANDIDATE,
    &refractory_period::CANDIDATE,
    &threshold_mismatch::CANDIDATE,
    &threshold_asymmetry::CANDIDATE,
    &junction_leak::CANDIDATE,
    &photocurrent_leak::CANDIDATE,
    &shot_noise::CANDIDATE,
    &background_activity::CANDIDATE,
    &hot_pixels::CANDIDATE,
    &dead_pixels::CANDIDATE,
    &adaptation::CANDIDATE,
    &dark_current::CANDIDATE,
    &temperature_drift::CANDIDATE,
    &event_drop::CANDIDATE,
    &stamp_jitter::CANDIDATE,
    &pixel_latency::CANDIDATE,
    &clock_offset::CANDIDATE,
    &clock_skew::CANDIDATE,
    &frame_interpolation::CANDIDATE,
    &exposure_blur::CANDIDATE,
    &rolling_shutter::CANDIDATE,
    &black_level::CANDIDATE,
    &defocus::CANDIDATE,
    &misregistration::CANDIDATE,
    &flicker::CANDIDATE,
    &vibration::CANDIDATE,
    &tone_curve::CANDIDATE,
    &vignetting::CANDIDATE,
    &frame_noise::CANDIDATE,
    &moving_shadow::CANDIDATE,
];

/// Starting points of one log-fitted parameter.
fn logs(values: &[f64]) -> Vec<Vec<f64>> {
    values.iter().map(|v| vec![v.ln()]).collect()
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
