//! The library of effects, as they show in a prediction: one effect a file.

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

/// Where in the chain an effect acts; earlier stages act first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SignalStage {
    /// On the light before the pixel.
    Light,
    /// In the photoreceptor.
    Receptor,
    /// On the signal as a slow drift.
    Drift,
    /// In the pixel's law.
    Law,
    /// On the clock.
    Clock,
}

impl SignalStage {
    pub(crate) const ALL: [Self; 5] =
        [Self::Light, Self::Receptor, Self::Drift, Self::Law, Self::Clock];

    /// Those that leave the signal as it is.
    pub(crate) const AFTER_SIGNAL: [Self; 2] = [Self::Law, Self::Clock];
}

/// A parameter of an effect.
#[derive(Debug, Clone, Copy)]
pub struct EffectParameter {
    /// Its key, with the unit in it.
    pub key: &'static str,
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Whether it is fitted as its logarithm.
    pub is_log: bool,
    /// Whether it keeps the value it starts with.
    pub is_fixed: bool,
    /// Whether it is left out of the result: it serves the fit alone.
    pub is_hidden: bool,
    /// Step of a difference quotient, in the fitted coordinate.
    pub step: f64,
}

impl EffectParameter {
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

    /// From the number that is reported to the coordinate that is fitted.
    #[must_use]
    pub fn to_fitted(&self, value: f64) -> f64 {
        if self.is_log { value.ln() } else { value }
    }

    /// From the coordinate that is fitted to the number that is reported.
    #[must_use]
    pub fn from_fitted(&self, value: f64) -> f64 {
        if self.is_log { value.exp() } else { value }
    }

    /// Its range in the fitted coordinate.
    #[must_use]
    pub fn fitted_range(&self) -> [f64; 2] {
        self.range.map(|end| self.to_fitted(end))
    }

    /// Its step in the fitted coordinate.
    #[must_use]
    pub const fn fitted_step(&self) -> f64 {
        self.step
    }
}

/// A nuisance that an effect lets out of its ordinary range.
#[derive(Debug, Clone, Copy)]
pub struct FreedNuisance {
    /// Which.
    pub nuisance: Nuisance,
    /// The range it gets, in its fitted coordinate.
    pub range: [f64; 2],
}

/// Parameters by key that follow from an effect's own.
pub type DerivedParameters = fn(&Evidence, &[f64]) -> Vec<(&'static str, f64)>;

/// An effect of the library: its equation, what it does to a prediction, what it is taken for.
#[derive(Debug)]
pub struct CandidateEffect {
    /// Its name everywhere.
    pub id: EffectId,
    /// Its governing equation.
    pub equation: &'static str,
    /// Where the equation stands.
    pub source: &'static str,
    /// Where it acts.
    pub stage: SignalStage,
    /// Its own parameters; those of a freed nuisance are only reported.
    pub parameters: &'static [EffectParameter],
    /// The nuisances it lets out of their ordinary range.
    pub freed: &'static [FreedNuisance],
    /// Values of its parameters (or freed nuisances, in fitted coordinates) to start a fit from.
    pub starting_points: fn(&Evidence) -> Vec<Vec<f64>>,
    /// What it does to a pixel, given its parameters and the pixel's kind.
    pub apply: fn(&[f64], PixelStratum, &mut PredictedPixel<'_>),
    /// The kinds of pixel it tells apart, given its number in a hypothesis.
    pub mixture: Option<fn(&Hypothesis, usize) -> PixelMixture>,
    /// Its parameters out of a hypothesis's values, for an effect that frees nuisances.
    pub report_freed: fn(&[f64]) -> Vec<f64>,
    /// Parameters that follow from its own, by key: what is fitted is not always what is asked.
    pub derived: DerivedParameters,
    /// Effects it is taken for.
    pub competing: &'static [EffectId],
    /// Effects that no events alone can tell from it.
    pub inseparable: &'static [EffectId],
    /// Effects whose law is the very same for some of their values.
    pub same_law: &'static [EffectId],
    /// Whether it shows in pixels that have no events only: what is judged behind events does not see it.
    pub acts_on_silent_pixels: bool,
    /// What separates it from its rivals: what to record.
    pub separating_recording: &'static str,
    /// Why it cannot be judged from this evidence.
    pub requires: fn(&Evidence) -> Result<(), String>,
    /// Where the clocks' offset lies when the effect has these parameters and the tie of the clocks
    /// holds in the middle; none where the effect is no matter of them.
    pub offset_us: fn(&Evidence, &[f64]) -> Option<f64>,
    /// Nuisances that may have stood in for it, and where they begin beside it, in their fitted coordinates.
    pub nuisance_resets: &'static [(Nuisance, f64)],
    /// By how much greater the logarithm of the thresholds begins beside it where those do not stand in: what
    /// makes a pixel fire by itself is taken for thresholds that are low.
    pub theta_raises: &'static [f64],
    /// Standard error of what its first parameter is measured against, in the parameter's unit: what a
    /// session states of its clocks is known no better.
    pub reference_error: fn(&Evidence) -> f64,
    /// Whether the signature that belongs to it is in the events, given its parameters; a gain
    /// without it does not name the effect.
    pub has_signature: fn(&Evidence, &[f64]) -> bool,
    /// One sentence on what was found.
    pub describe: fn(&[f64]) -> String,
}

impl CandidateEffect {
    /// Its parameters as they are reported, by key, for values of its own.
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

/// Fills what most effects leave as it is.
const PLAIN: CandidateEffect = CandidateEffect {
    id: EffectId::RefractoryPeriod,
    equation: "",
    source: "",
    stage: SignalStage::Law,
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

/// Every effect that can be named but those that a census of the whole sensor counts. The last four are
/// in no pixel's law: frames show them or nothing does.
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

/// One start a value, for an effect of one parameter that is fitted as its logarithm.
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
        Err(format!("{has:.1} s were recorded; it takes {seconds} s"))
    }
}
