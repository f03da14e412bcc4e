//! A fitted hypothesis as a camera for event generation.

use crate::diagnose::model::registration::FittedRegistration;
use crate::diagnose::{Evidence, FittedEffect, Hypothesis, Nuisance, SessionFacts};
use evrig_core::effect_id::EffectId;
use evrig_generate::effect::{
    AppliedEffect, Effect, EffectSet, RecordingContext, Region, SignalStage,
};
use evrig_generate::forward::{BandNoise, CameraConstants, ForwardParameters, ThresholdScatter};
use evrig_generate::voltmeter::Coefficients;
use serde::{Deserialize, Serialize};

const SIGNAL_STEP_US: u32 = 1_000;

/// The event camera of a hypothesis; each effect is the generator's own implementation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedCamera {
    /// The camera, for any signal.
    pub camera: CameraConstants,
    /// Registration to the signal of its recording.
    #[serde(alias = "seen")]
    pub registration: FittedRegistration,
    /// Named effects: in the camera's effects, in its law or in the signal.
    pub named: Vec<EffectId>,
    /// What the generator cannot represent.
    pub left_out: Vec<String>,
}

impl FittedCamera {
    /// The camera of a hypothesis, with `named` effects of pixels and readout; `None` where the
    /// generator cannot represent its law.
    #[must_use]
    pub fn of(
        evidence: &Evidence,
        hypothesis: &Hypothesis,
        named: &[FittedEffect],
    ) -> Option<Self> {
        let law = hypothesis.law();
        let theta = (law.theta_on * law.theta_off).sqrt();
        let leak_per_us = law.leak_per_s / law.theta_on * 1e-6;
        let k = Coefficients::new([1.0 / theta, 1e-9, 0.0, leak_per_us, 0.0, 0.0]).ok()?;
        let (mut applied, mut left_out) = (Vec::new(), Vec::new());
        for effect in
            fitted_effects(evidence, hypothesis).chain(sensor_wide_effects(hypothesis, named))
        {
            match effect {
                Ok(effect) => applied.push(effect),
                Err(why) => left_out.push(why),
            }
        }
        let effects = EffectSet::new(applied).ok()?;
        let (noise, scatter) = noise(hypothesis, theta);
        let camera = CameraConstants {
            generator: ForwardParameters { k, effects, step_us: SIGNAL_STEP_US },
            on_over_nominal: (0.5 * hypothesis.nuisance(Nuisance::LogRatio)).exp(),
            noise,
            scatter,
            background_hz: law.background_on_hz + law.background_off_hz,
        };
        let named = named.iter().map(|effect| effect.id).collect();
        Some(Self {
            camera,
            registration: FittedRegistration::of(evidence, hypothesis),
            named,
            left_out,
        })
    }

    /// Bounds the background rate by `most_hz`. A fit uses active pixels, whose unexplained events
    /// count as background; silent pixels bound it.
    #[must_use]
    pub fn with_background_up_to(mut self, most_hz: f64) -> Self {
        self.camera.background_hz = self.camera.background_hz.min(most_hz);
        self
    }
}

/// What effects of readout and frames depend on in a recording.
#[must_use]
pub fn surroundings(facts: &SessionFacts) -> RecordingContext {
    RecordingContext { aps_starts_us: facts.aps_us.clone(), frame_times_us: facts.aps_us.clone() }
}

/// An effect for the generator, or why it cannot be represented.
type EffectResult = Result<AppliedEffect, String>;

fn effect_result(id: EffectId, parameters: &[(&str, f64)], region: Option<Region>) -> EffectResult {
    let effect = Effect::from_parameters(id, parameters).map_err(|e| format!("{id}: {e}"))?;
    Ok(AppliedEffect { effect, region })
}

/// Effects of a hypothesis beyond its law and its signal.
fn fitted_effects(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
) -> impl Iterator<Item = EffectResult> {
    // A freed nuisance is in the law and the signal already; in a region the prior holds outside.
    let is_told = |index: &usize| {
        hypothesis.effects[*index].freed.is_empty() || hypothesis.regions[*index].is_some()
    };
    (0..hypothesis.effects.len()).filter(is_told).map(|index| {
        let side = |[low, high]: [u16; 2]| Some([f64::from(low), f64::from(high)]);
        let region =
            hypothesis.regions[index].map(|r| Region { x_px: side(r.x_px), y_px: side(r.y_px) });
        effect_result(
            hypothesis.effects[index].id,
            &excess_over_prior(evidence, hypothesis, index),
            region,
        )
    })
}

/// Effects from sensor-wide statistics. Departures of frames and optics are in the signal.
fn sensor_wide_effects(
    hypothesis: &Hypothesis,
    named: &[FittedEffect],
) -> impl Iterator<Item = EffectResult> {
    let is_fitted = |id| hypothesis.effects.iter().any(|effect| effect.id == id);
    named.iter().filter(move |effect| !is_fitted(effect.id)).filter_map(|effect| {
        let values: Vec<(&str, f64)> =
            effect.parameters.iter().map(|(key, p)| (key.as_str(), p.value)).collect();
        let applied = effect_result(effect.id, &values, None);
        let is_in_light =
            |applied: &AppliedEffect| applied.effect.model().stage() < SignalStage::Memory;
        (!applied.as_ref().is_ok_and(is_in_light)).then_some(applied)
    })
}

/// An effect's parameters; those of a nuisance freed in a region relative to the prior outside.
fn excess_over_prior(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    index: usize,
) -> Vec<(&'static str, f64)> {
    let effect = hypothesis.effects[index];
    let mut values = hypothesis.named_parameters(evidence, index);
    if effect.freed.is_empty() {
        return values;
    }
    let elsewhere = (effect.report_freed)(&hypothesis.values);
    let first = values.iter_mut().zip(&elsewhere).take(1);
    first.for_each(|((_, there), elsewhere)| match effect.id {
        EffectId::ThresholdAsymmetry => *there /= elsewhere,
        EffectId::Defocus => {
            *there = (there.powi(2) - elsewhere.powi(2)).max(0.0).sqrt();
        }
        _ => *there -= elsewhere,
    });
    values
}

/// The noise of the law: the part that enters the reference level as signal noise, the rest as
/// threshold noise.
fn noise(hypothesis: &Hypothesis, theta: f64) -> (BandNoise, ThresholdScatter) {
    let law = hypothesis.law();
    let hz = hypothesis.nuisance(Nuisance::LogNoiseHz).exp();
    let (scale, light_exponent) = (law.noise_at_white / theta, law.noise_exponent);
    // Standard deviation of a logistic law; a change has the signal's noise twice.
    let rms = 1.813_8 * scale * (0.5 * law.noise_carry).sqrt();
    let bandwidth_hz = (hz / std::f64::consts::TAU).clamp(20.0, 1_000.0);
    let scatter = ThresholdScatter {
        scale: scale * (1.0 - law.noise_carry).sqrt(),
        light_exponent,
        // The law's hazard at rest is this rate times the share of the noise beyond the threshold.
        redrawn_hz: 0.5 * hz,
    };
    (BandNoise { rms, bandwidth_hz, light_exponent }, scatter)
}
