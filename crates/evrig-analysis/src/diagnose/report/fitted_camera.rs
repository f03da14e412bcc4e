//! A fitted hypothesis as a camera that makes events by itself.

use crate::diagnose::model::registration::FittedRegistration;
use crate::diagnose::{Evidence, FittedEffect, Hypothesis, Nuisance, SessionFacts};
use evrig_core::effect_id::EffectId;
use evrig_generate::effect::{Applied, Effect, Effects, Enters, Region, Surroundings};
use evrig_generate::forward::{BandNoise, Camera, ForwardParameters, Scatter};
use evrig_generate::voltmeter::Coefficients;
use serde::{Deserialize, Serialize};

const SIGNAL_STEP_US: u32 = 1_000;

/// What a hypothesis makes of the event camera, each effect by the generator's own account of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedCamera {
    /// The camera, for any light.
    pub camera: Camera,
    /// How it saw the light of its recording.
    #[serde(alias = "seen")]
    pub registration: FittedRegistration,
    /// What was named, be it in the camera's effects, in its law or in the light.
    pub named: Vec<EffectId>,
    /// What the generator could not be told.
    pub left_out: Vec<String>,
}

impl FittedCamera {
    /// The camera of a hypothesis, with what was `named` beside it of pixels and readout; `None` where
    /// its law is none that a generator knows.
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
        let effects = Effects::new(applied).ok()?;
        let (noise, scatter) = noise(hypothesis, theta);
        let camera = Camera {
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

    /// With no more background than `most_hz`, Hz. A fit looks at pixels that fire; what it cannot place
    /// there is background to it, of which the others may have none.
    #[must_use]
    pub fn with_background_up_to(mut self, most_hz: f64) -> Self {
        self.camera.background_hz = self.camera.background_hz.min(most_hz);
        self
    }
}

/// What effects of readout and frames go by in a recording.
#[must_use]
pub fn surroundings(facts: &SessionFacts) -> Surroundings {
    Surroundings { aps_starts_us: facts.aps_us.clone(), frame_times_us: facts.aps_us.clone() }
}

/// An effect for the generator, or why it cannot be told of it.
type EffectResult = Result<Applied, String>;

fn effect_result(id: EffectId, parameters: &[(&str, f64)], region: Option<Region>) -> EffectResult {
    let effect = Effect::from_parameters(id, parameters).map_err(|e| format!("{id}: {e}"))?;
    Ok(Applied { effect, region })
}

/// The effects of a hypothesis beyond its law and its light.
fn fitted_effects(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
) -> impl Iterator<Item = EffectResult> {
    // A nuisance that an effect let out of its range is in the law and the light already; in a region
    // they have what is ordinary elsewhere.
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

/// What a census of all events named, of which no pixel's score knows. Frames and optics that depart
/// from their statement are in the light.
fn sensor_wide_effects(
    hypothesis: &Hypothesis,
    named: &[FittedEffect],
) -> impl Iterator<Item = EffectResult> {
    let is_fitted = |id| hypothesis.effects.iter().any(|effect| effect.id == id);
    named.iter().filter(move |effect| !is_fitted(effect.id)).filter_map(|effect| {
        let values: Vec<(&str, f64)> =
            effect.parameters.iter().map(|(key, p)| (key.as_str(), p.value)).collect();
        let applied = effect_result(effect.id, &values, None);
        let is_in_light = |applied: &Applied| applied.effect.acts().enters() < Enters::Memory;
        (!applied.as_ref().is_ok_and(is_in_light)).then_some(applied)
    })
}

/// An effect's parameters, those of a nuisance that it frees in a region against what the nuisance is
/// elsewhere.
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

/// The law's noise: the part that the pixel memorises with the light as a signal's, the other as that of its
/// thresholds.
fn noise(hypothesis: &Hypothesis, theta: f64) -> (BandNoise, Scatter) {
    let law = hypothesis.law();
    let hz = hypothesis.nuisance(Nuisance::LogNoiseHz).exp();
    let (scale, light_exponent) = (law.noise_at_white / theta, law.noise_exponent);
    // A logistic law's standard deviation; a change has the signal's noise twice.
    let rms = 1.813_8 * scale * (0.5 * law.noise_carry).sqrt();
    let bandwidth_hz = (hz / std::f64::consts::TAU).clamp(20.0, 1_000.0);
    let scatter = Scatter {
        scale: scale * (1.0 - law.noise_carry).sqrt(),
        light_exponent,
        // At rest the law's hazard is this rate times the share of the noise beyond the threshold.
        redrawn_hz: 0.5 * hz,
    };
    (BandNoise { rms, bandwidth_hz, light_exponent }, scatter)
}
