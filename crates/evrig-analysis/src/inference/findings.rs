//! Named effects: accepted ones, and constants that lie surely outside their ordinary range.

use super::constants::CameraConstant;
use super::fit::{ModelFit, fit, paired_gain};
use super::goodness::SIGNIFICANT_STANDARD_ERRORS;
use super::intervals::standard_errors;
use super::select::{EffectSelection, is_significant};
use crate::diagnose::report::departure::upper_tail_probability;
use crate::diagnose::{CompetingHypothesis, ConfidenceInterval, Evidence, FittedEffect, LIBRARY};
use evrig_core::effect_id::EffectId;
use evrig_core::stats::Z90;

/// Named effects and the baseline: the final model without them.
pub(super) struct Findings {
    pub(super) effects: Vec<FittedEffect>,
    pub(super) baseline: ModelFit,
    pub(super) errors: Vec<f64>,
}

impl Findings {
    pub(super) fn of(evidence: &Evidence, found: &EffectSelection) -> Self {
        let errors = standard_errors(evidence, &found.fit);
        let mut effects: Vec<FittedEffect> =
            (0..found.steps.len()).map(|i| structural(evidence, found, &errors, i)).collect();
        let outside = constants_outside(evidence, &found.fit, &errors);
        let spread = found.spread_ci[1] > MAX_ORDINARY_SPREAD;
        for id in outside.iter().copied().chain(spread.then_some(EffectId::ThresholdMismatch)) {
            let without = without(evidence, &found.fit, id);
            let gain = paired_gain(evidence, &found.fit.evaluation, &without.evaluation, true);
            if is_significant(gain) {
                effects.push(constant_effect(evidence, found, &errors, id, gain));
            }
        }
        let baseline = baseline(evidence, found, &effects);
        Self { effects, baseline, errors }
    }
}

/// Largest spread of the thresholds that is not reported: the published generator draws identical
/// pixels, and 5 % changes no interval by more than its noise.
const MAX_ORDINARY_SPREAD: f64 = 0.05;

/// Effects of constants that lie surely outside their ordinary range.
fn constants_outside(evidence: &Evidence, fit: &ModelFit, errors: &[f64]) -> Vec<EffectId> {
    let mut found = Vec::new();
    for constant in CameraConstant::ALL {
        let prior = constant.prior(&evidence.facts);
        let (value, error) = (fit.model.constant(constant), errors[constant as usize]);
        let reach = SIGNIFICANT_STANDARD_ERRORS * error;
        let is_outside = value - reach > prior.ordinary[1] || value + reach < prior.ordinary[0];
        let id = constant.effect(value).map(|id| delayed(evidence, id));
        if let Some(id) = id.filter(|id| is_outside && !found.contains(id)) {
            found.push(id);
        }
    }
    found
}

/// A delay of the events alone is a pixel latency where the camera's own frames are on time.
fn delayed(evidence: &Evidence, id: EffectId) -> EffectId {
    match evidence.facts.clock_tie {
        Some(tie) if id == EffectId::ClockOffset && !tie.is_off() => EffectId::PixelLatency,
        _ => id,
    }
}

/// The model with the constants of an effect inside their ordinary ranges.
fn without(evidence: &Evidence, found: &ModelFit, id: EffectId) -> ModelFit {
    let mut model = found.model.clone();
    if id == EffectId::ThresholdMismatch {
        model.limit_spread(MAX_ORDINARY_SPREAD);
    }
    for constant in CameraConstant::ALL {
        let own = constant.effect(model.constant(constant)).map(|id| delayed(evidence, id));
        if own == Some(id) {
            let [low, high] = constant.prior(&evidence.facts).ordinary;
            model.limits.push((constant, [low, high]));
        }
    }
    fit(evidence, model, N_REFIT_STEPS)
}

const N_REFIT_STEPS: usize = 6;

/// Constants alone, those of named effects within their ordinary ranges.
fn baseline(evidence: &Evidence, found: &EffectSelection, effects: &[FittedEffect]) -> ModelFit {
    let mut model = found.calibrated.model.clone();
    let mut is_changed = false;
    for constant in CameraConstant::ALL {
        let ids = [model.constant(constant), -model.constant(constant)]
            .map(|v| constant.effect(v).map(|id| delayed(evidence, id)));
        if effects.iter().any(|effect| ids.contains(&Some(effect.id))) {
            model.limits.push((constant, constant.prior(&evidence.facts).ordinary));
            is_changed = true;
        }
    }
    if effects.iter().any(|effect| effect.id == EffectId::ThresholdMismatch) {
        model.limit_spread(MAX_ORDINARY_SPREAD);
        is_changed = true;
    }
    if is_changed { fit(evidence, model, N_REFIT_STEPS) } else { found.calibrated.clone() }
}

pub(super) fn interval(value: f64, error: f64, natural: impl Fn(f64) -> f64) -> ConfidenceInterval {
    let mut ends = [value - Z90 * error, value + Z90 * error].map(&natural);
    if ends[0] > ends[1] {
        ends.swap(0, 1);
    }
    ConfidenceInterval {
        value: natural(value),
        ci90: ends.map(|end| Some(end).filter(|end| end.is_finite())),
    }
}

/// An effect of the library with its fitted parameters.
fn fitted_effect(
    id: EffectId,
    parameters: Vec<(&'static str, ConfidenceInterval)>,
    (gain, error): (f64, f64),
) -> FittedEffect {
    let candidate = LIBRARY.iter().find(|c| c.id == id);
    let values: Vec<f64> = parameters.iter().map(|(_, p)| p.value).collect();
    let described = candidate.map(|c| (c.describe)(&values)).unwrap_or_default();
    let p_value = (upper_tail_probability(gain / error) * LIBRARY.len() as f64).min(1.0);
    FittedEffect {
        id,
        name: id.name().into(),
        equation: candidate.map_or("", |c| c.equation).into(),
        description: described,
        parameters: parameters.into_iter().map(|(key, p)| (key.to_owned(), p)).collect(),
        heldout_gain_nats_per_event: gain,
        heldout_gain_error: error,
        p_value,
        region: None,
        indistinguishable: candidate.map(|c| c.same_law.to_vec()).unwrap_or_default(),
        competing_hypotheses: Vec::new(),
    }
}

fn structural(
    evidence: &Evidence,
    found: &EffectSelection,
    errors: &[f64],
    index: usize,
) -> FittedEffect {
    let step = &found.steps[index];
    let model = &found.fit.model;
    let at = model.offset_of(index);
    let own =
        step.effect.parameters.iter().enumerate().map(|(i, p)| {
            (p.key, interval(model.values[at + i], errors[at + i], |v| p.natural(v)))
        });
    let all: Vec<(&'static str, ConfidenceInterval)> = own.collect();
    let reported = (step.effect.report)(evidence, all);
    let mut effect = fitted_effect(step.effect.id, reported, (step.gain, step.error));
    effect.competing_hypotheses = step
        .others
        .iter()
        .map(|(other, gain, _)| CompetingHypothesis {
            id: other.id,
            heldout_gain_nats_per_event: *gain,
        })
        .collect();
    let near = step.others.iter().filter(|(_, gain, error)| {
        step.gain - gain < 2.0 * step.error.hypot(*error) && *gain > 0.5 * step.gain
    });
    effect.indistinguishable.extend(near.map(|(other, ..)| other.id));
    effect
}

fn constant_effect(
    evidence: &Evidence,
    found: &EffectSelection,
    errors: &[f64],
    id: EffectId,
    gain: (f64, f64),
) -> FittedEffect {
    use CameraConstant as C;
    let facts = &evidence.facts;
    let of = |c: C, natural: &dyn Fn(f64) -> f64| {
        interval(found.fit.model.constant(c), errors[c as usize], natural)
    };
    let dn = facts.white_dn / facts.light_per_pedestal;
    let key = |i: usize| id.parameters().get(i).copied().unwrap_or_default();
    let parameters = match id {
        EffectId::ThresholdAsymmetry => vec![(key(0), of(C::LogRatio, &f64::exp))],
        EffectId::JunctionLeak => vec![(key(0), of(C::LeakHz, &|v| v))],
        EffectId::PhotocurrentLeak => vec![(key(0), of(C::PhotoLeakHz, &|v| v))],
        EffectId::DarkCurrent => vec![(key(0), of(C::Pedestal, &|v| v))],
        EffectId::BlackLevel => vec![(key(0), of(C::Pedestal, &|v| -v * dn))],
        EffectId::ClockOffset | EffectId::PixelLatency => vec![(key(0), of(C::OffsetUs, &|v| v))],
        EffectId::Defocus => {
            vec![(key(0), of(C::BlurPx2, &|v: f64| v.abs().sqrt() * v.signum()))]
        }
        EffectId::BackgroundActivity => {
            let [on, off] = [C::LogBackgroundOn, C::LogBackgroundOff].map(|c| of(c, &f64::exp));
            let sum = |i: usize| on.ci90[i].zip(off.ci90[i]).map(|(a, b)| a + b);
            let all = ConfidenceInterval { value: on.value + off.value, ci90: [sum(0), sum(1)] };
            vec![(key(0), all)]
        }
        EffectId::ThresholdMismatch => {
            let [value, low, high] = found.spread_ci;
            vec![(key(0), ConfidenceInterval { value, ci90: [Some(low), Some(high)] })]
        }
        _ => vec![
            ("shift_x_px", of(C::ShiftX, &|v| v)),
            ("shift_y_px", of(C::ShiftY, &|v| v)),
            ("rotation_deg", of(C::RotationDeg, &|v| v)),
            ("scale", of(C::Scale, &|v| 1.0 + v)),
        ],
    };
    fitted_effect(id, parameters, gain)
}
