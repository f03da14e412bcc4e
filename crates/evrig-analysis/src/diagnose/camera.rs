//! A fitted hypothesis as a camera that makes events by itself.

use super::tuned::Seen;
use super::{Evidence, Facts, FittedEffect, Hypothesis, Nuisance};
use evrig_core::effect_id::EffectId;
use evrig_generate::effect::{
    AppliedEffect, Effect, EffectSet, RecordingContext, Region, SignalStage,
};
use evrig_generate::forward::{BandNoise, CameraConstants, ForwardParameters, ThresholdScatter};
use evrig_generate::voltmeter::Coefficients;
use serde::{Deserialize, Serialize};

/// From one instant of the light to the next, microseconds.
const STEP_US: u32 = 1_000;

/// What a hypothesis makes of the event camera, each effect by the generator's own account of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedCamera {
    /// The camera, for any light.
    pub camera: CameraConstants,
    /// How it saw the light of its recording.
    pub seen: Seen,
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
        for told in fitted(evidence, hypothesis).chain(beside(hypothesis, named)) {
            match told {
                Ok(effect) => applied.push(effect),
                Err(why) => left_out.push(why),
            }
        }
        let effects = EffectSet::new(applied).ok()?;
        let (noise, scatter) = noise(hypothesis, theta);
        let camera = CameraConstants {
            generator: ForwardParameters { k, effects, step_us: STEP_US },
            on_over_nominal: (0.5 * hypothesis.nuisance(Nuisance::LogRatio)).exp(),
            noise,
            scatter,
            background_hz: law.background_on_hz + law.background_off_hz,
        };
        let named = named.iter().map(|effect| effect.id).collect();
        Some(Self { camera, seen: Seen::of(evidence, hypothesis), named, left_out })
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
pub fn surroundings(facts: &Facts) -> RecordingContext {
    RecordingContext { aps_starts_us: facts.aps_us.clone(), frame_times_us: facts.aps_us.clone() }
}

/// An effect for the generator, or why it cannot be told of it.
type Told = Result<AppliedEffect, String>;

fn told(id: EffectId, parameters: &[(&str, f64)], region: Option<Region>) -> Told {
    let effect = Effect::from_parameters(id, parameters).map_err(|e| format!("{id}: {e}"))?;
    Ok(AppliedEffect { effect, region })
}

/// The effects of a hypothesis beyond its law and its light.
fn fitted(evidence: &Evidence, hypothesis: &Hypothesis) -> impl Iterator<Item = Told> {
    // A nuisance that an effect let out of its range is in the law and the light already; in a region
    // they have what is ordinary elsewhere.
    let is_told = |index: &usize| {
        hypothesis.effects[*index].frees.is_empty() || hypothesis.regions[*index].is_some()
    };
    (0..hypothesis.effects.len()).filter(is_told).map(|index| {
        let side = |[low, high]: [u16; 2]| Some([f64::from(low), f64::from(high)]);
        let region =
            hypothesis.regions[index].map(|r| Region { x_px: side(r.x_px), y_px: side(r.y_px) });
        told(hypothesis.effects[index].id, &beyond_ordinary(evidence, hypothesis, index), region)
    })
}

/// What a census of all events named, of which no pixel's score knows. Frames and optics that depart
/// from their statement are in the light.
fn beside(hypothesis: &Hypothesis, named: &[FittedEffect]) -> impl Iterator<Item = Told> {
    let is_fitted = |id| hypothesis.effects.iter().any(|effect| effect.id == id);
    named.iter().filter(move |effect| !is_fitted(effect.id)).filter_map(|effect| {
        let values: Vec<(&str, f64)> =
            effect.parameters.iter().map(|(key, p)| (key.as_str(), p.value)).collect();
        let told = told(effect.id, &values, None);
        let is_in_light = |told: &AppliedEffect| told.effect.model().stage() < SignalStage::Memory;
        (!told.as_ref().is_ok_and(is_in_light)).then_some(told)
    })
}

/// An effect's parameters, those of a nuisance that it frees in a region against what the nuisance is
/// elsewhere.
fn beyond_ordinary(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    index: usize,
) -> Vec<(&'static str, f64)> {
    let effect = hypothesis.effects[index];
    let mut told = hypothesis.told(evidence, index);
    if effect.frees.is_empty() {
        return told;
    }
    let elsewhere = (effect.report)(&hypothesis.values);
    let first = told.iter_mut().zip(&elsewhere).take(1);
    first.for_each(|((_, there), elsewhere)| match effect.id {
        EffectId::ThresholdAsymmetry => *there /= elsewhere,
        EffectId::Defocus => {
            *there = (there.powi(2) - elsewhere.powi(2)).max(0.0).sqrt();
        }
        _ => *there -= elsewhere,
    });
    told
}

/// The law's noise: the part that the pixel memorises with the light as a signal's, the other as that of its
/// thresholds.
fn noise(hypothesis: &Hypothesis, theta: f64) -> (BandNoise, ThresholdScatter) {
    let law = hypothesis.law();
    let hz = hypothesis.nuisance(Nuisance::LogNoiseHz).exp();
    let (scale, light_exponent) = (law.noise_at_white / theta, law.noise_exponent);
    // A logistic law's standard deviation; a change has the signal's noise twice.
    let rms = 1.813_8 * scale * (0.5 * law.noise_memorised).sqrt();
    let bandwidth_hz = (hz / std::f64::consts::TAU).clamp(20.0, 1_000.0);
    let scatter = ThresholdScatter {
        scale: scale * (1.0 - law.noise_memorised).sqrt(),
        light_exponent,
        // At rest the law's hazard is this rate times the share of the noise beyond the threshold.
        redrawn_hz: 0.5 * hz,
    };
    (BandNoise { rms, bandwidth_hz, light_exponent }, scatter)
}
