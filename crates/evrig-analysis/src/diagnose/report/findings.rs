//! Named effects with their parameters.

use crate::diagnose::effect::{ModelTerm, library_effect};
use crate::diagnose::fit::candidate::EffectCandidate;
use crate::diagnose::fit::intervals::standard_errors;
use crate::diagnose::fit::optimizer::{FitTolerance, ModelFit, fit};
use crate::diagnose::fit::paired_gain::PairedGain;
use crate::diagnose::fit::selection::EffectSelection;
use crate::diagnose::model::constants::CameraConstant;
use crate::diagnose::report::departure::upper_tail_probability;
use crate::diagnose::{CompetingHypothesis, ConfidenceInterval, Evidence, FittedEffect, LIBRARY};
use evrig_core::effect_id::EffectId;
use evrig_core::stats::Z90;

/// Named effects and the baseline: the final model without them.
pub(crate) struct Findings {
    pub(crate) effects: Vec<FittedEffect>,
    pub(crate) baseline: ModelFit,
    pub(crate) errors: Vec<f64>,
}

impl Findings {
    pub(crate) fn of(evidence: &Evidence, found: &EffectSelection) -> Self {
        let errors = standard_errors(evidence, &found.fit);
        let mut effects: Vec<FittedEffect> =
            (0..found.steps.len()).map(|i| accepted(evidence, found, &errors, i)).collect();
        let mut baseline = found.calibrated.clone();
        if found.spread_ci[1] > MAX_ORDINARY_SPREAD {
            let without = with_ordinary_spread(evidence, &found.fit);
            let gain = PairedGain::of(evidence, &found.fit.evaluation, &without.evaluation);
            if gain.is_significant() {
                let id = EffectId::ThresholdMismatch;
                effects.push(constant_effect(evidence, found, &errors, id, gain));
                baseline = with_ordinary_spread(evidence, &baseline);
            }
        }
        Self { effects, baseline, errors }
    }
}

fn with_ordinary_spread(evidence: &Evidence, fitted: &ModelFit) -> ModelFit {
    let mut model = fitted.model.clone();
    model.limit_spread(MAX_ORDINARY_SPREAD);
    fit(evidence, model, N_REFIT_STEPS, FitTolerance::Fine)
}

const N_REFIT_STEPS: usize = 6;

/// Largest spread of the thresholds that is not reported: the published generator draws identical
/// pixels, and 5 % changes no interval by more than its noise.
const MAX_ORDINARY_SPREAD: f64 = 0.05;

pub(crate) fn interval(value: f64, error: f64, natural: impl Fn(f64) -> f64) -> ConfidenceInterval {
    let mut ends = [value - Z90 * error, value + Z90 * error].map(&natural);
    if ends[0] > ends[1] {
        ends.swap(0, 1);
    }
    let is_known = |end: &f64| error.is_finite() && end.is_finite();
    ConfidenceInterval { value: natural(value), ci90: ends.map(|end| Some(end).filter(is_known)) }
}

/// An interval with the standard error of what the value is measured against.
fn against(reference_error: f64, own: ConfidenceInterval) -> ConfidenceInterval {
    let end = |end: Option<f64>| {
        let away = end? - own.value;
        Some(own.value + away.signum() * away.hypot(Z90 * reference_error))
    };
    ConfidenceInterval { ci90: own.ci90.map(end), ..own }
}

/// An effect of the library with its fitted parameters.
fn fitted_effect(
    evidence: &Evidence,
    id: EffectId,
    parameters: Vec<(&'static str, ConfidenceInterval)>,
    gain: PairedGain,
) -> FittedEffect {
    let candidate = library_effect(id);
    let values: Vec<f64> = parameters.iter().map(|(_, p)| p.value).collect();
    let described = candidate.map(|c| (c.describe)(&values)).unwrap_or_default();
    let mut indistinguishable = candidate.map(|c| c.same_law.to_vec()).unwrap_or_default();
    if evidence.facts.clock_tie.is_none() {
        indistinguishable.extend(candidate.map_or(&[][..], |c| c.inseparable));
    }
    let p_value = (upper_tail_probability(gain.standard_errors) * LIBRARY.len() as f64).min(1.0);
    FittedEffect {
        id,
        name: id.name().into(),
        equation: candidate.map_or("", |c| c.equation).into(),
        description: described,
        parameters: parameters.into_iter().map(|(key, p)| (key.to_owned(), p)).collect(),
        heldout_gain_nats_per_event: gain.mean,
        heldout_gain_error: gain.error,
        p_value,
        indistinguishable,
        competing_hypotheses: Vec::new(),
    }
}

/// An accepted effect.
fn accepted(
    evidence: &Evidence,
    found: &EffectSelection,
    errors: &[f64],
    index: usize,
) -> FittedEffect {
    let step = &found.steps[index];
    let gain = step.gain;
    let mut effect = match step.candidate {
        EffectCandidate::Structural(own) => fitted_effect(
            evidence,
            own.id,
            structural_parameters(evidence, found, errors, own),
            gain,
        ),
        EffectCandidate::Freed(_) => constant_effect(evidence, found, errors, step.id, gain),
    };
    // All events of the sensor established the bursts, before any model.
    let bursts = evidence.bursts.as_ref().filter(|_| step.id == EffectId::ApsCoupling);
    if let Some(bursts) = bursts {
        effect.p_value = upper_tail_probability(bursts.z());
    }
    effect.competing_hypotheses = step
        .others
        .iter()
        .map(|(id, gain)| CompetingHypothesis { id: *id, heldout_gain_nats_per_event: gain.mean })
        .collect();
    let near = step.others.iter().filter(|(_, other)| {
        let error = gain.error.hypot(other.error);
        gain.mean - other.mean < 2.0 * error && other.mean > 0.5 * gain.mean
    });
    effect.indistinguishable.extend(near.map(|(id, ..)| *id));
    effect
}

fn structural_parameters(
    evidence: &Evidence,
    found: &EffectSelection,
    errors: &[f64],
    own: &ModelTerm,
) -> Vec<(&'static str, ConfidenceInterval)> {
    let model = &found.fit.model;
    let Some(index) = model.effects.iter().position(|effect| effect.id == own.id) else {
        return Vec::new();
    };
    let at = model.offset_of(index);
    let parameters =
        own.parameters.iter().enumerate().map(|(i, p)| {
            (p.key, interval(model.values[at + i], errors[at + i], |v| p.natural(v)))
        });
    let mut reported = (own.report)(evidence, parameters.collect());
    if own.id == EffectId::ClockSkew {
        // Microseconds at either end over half the duration.
        let ppm = evidence.facts.clock_error_us()[1] / (0.5 * evidence.seconds());
        reported[0].1 = against(ppm, reported[0].1);
    }
    reported
}

fn constant_effect(
    evidence: &Evidence,
    found: &EffectSelection,
    errors: &[f64],
    id: EffectId,
    gain: PairedGain,
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
        EffectId::ClockOffset | EffectId::PixelLatency => {
            vec![(key(0), against(facts.clock_error_us()[0], of(C::OffsetUs, &|v| v)))]
        }
        EffectId::StampJitter => vec![(key(0), of(C::LogStampError, &f64::exp))],
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
    fitted_effect(evidence, id, parameters, gain)
}
