//! Backward elimination: effects that later ones replace, that are unidentified, or whose gain is
//! at chance level.

use super::acceptance::{is_unidentified, with_strength_fixed_aside};
use super::accepted_effect::AcceptedEffect;
use crate::diagnose::Evidence;
use crate::diagnose::fit::cell_scores::{CellSet, is_significant};
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::fit::gauss_newton::{fit, score_model};
use crate::diagnose::fit::local_refinement::MAX_FINAL_STEPS;
use crate::diagnose::fit::local_refinement::fit_and_refine;
use crate::diagnose::fit::spatial_region::effect_gain;
use crate::diagnose::fit::standard_errors::with_standard_errors;

/// Gain, nats per event, above which only the structure test decides on an unidentified effect.
const MAX_UNIDENTIFIED_GAIN: f64 = 0.5;

const MAX_STEPS_AT_FIXED_STRENGTH: usize = 12;

/// Removes effects that later ones have replaced. Effects that the pixel subset misses clearly are
/// not refitted on all pixels. The last effect was tested beside all others already.
pub(crate) fn remove_replaced_effects(
    evidence: &Evidence,
    few: &Evidence,
    baseline: &FittedModel,
    mut model: FittedModel,
    mut taken: Vec<AcceptedEffect>,
) -> (FittedModel, Vec<AcceptedEffect>) {
    let n_taken = taken.len();
    let mut index = 0;
    while taken.len() > 1 && index < taken.len() {
        let (is_last, last) = (index + 1 == n_taken, &taken[index]);
        if is_last && is_significant(last.gain, last.error) {
            break;
        }
        match without_idle(evidence, few, baseline, &model, index) {
            Some(without) => {
                taken.remove(index);
                model = without;
            }
            None => index += 1,
        }
    }
    (model, taken)
}

/// The model without an effect, if the loss is not significant.
fn without_idle(
    evidence: &Evidence,
    few: &Evidence,
    baseline: &FittedModel,
    model: &FittedModel,
    index: usize,
) -> Option<FittedModel> {
    if is_missed(few, baseline, model, index) {
        return None;
    }
    let without = refit_without(evidence, baseline, model, index);
    let (loss, error) = effect_gain(evidence, model, index, &without);
    (!is_significant(loss, error)).then_some(without)
}

/// Whether the subset loses twice a significant gain without the effect.
fn is_missed(few: &Evidence, baseline: &FittedModel, model: &FittedModel, index: usize) -> bool {
    let here = score_model(few, model.hypothesis.clone());
    let without = refit_without(few, baseline, model, index);
    let (loss, error) = effect_gain(few, &here, index, &without);
    is_significant(0.5 * loss, error)
}

/// Removes unidentified effects, last accepted first; the model comes back with standard errors.
pub(crate) fn remove_unidentified_effects(
    evidence: &Evidence,
    baseline: &FittedModel,
    mut model: FittedModel,
    mut taken: Vec<AcceptedEffect>,
) -> (FittedModel, Vec<AcceptedEffect>) {
    loop {
        let known = with_standard_errors(evidence, model.clone());
        let fits_anywhere = |&index: &usize| {
            taken[index].gain < MAX_UNIDENTIFIED_GAIN
                && is_unidentified(&known, index)
                && !strength_is_identified(evidence, &known, index)
        };
        let Some(vague) = (0..taken.len()).rev().find(fits_anywhere) else {
            return (known, taken);
        };
        model = refit_without(evidence, baseline, &model, vague);
        taken.remove(vague);
    }
}

/// Removes effects with a gain below `bar`, nats per event, from the last accepted on.
pub(crate) fn remove_effects_below(
    evidence: &Evidence,
    baseline: &FittedModel,
    mut model: FittedModel,
    mut taken: Vec<AcceptedEffect>,
    bar: f64,
) -> (FittedModel, Vec<AcceptedEffect>) {
    while taken.last().is_some_and(|last| last.gain < bar) {
        taken.pop();
        model = refit_without(evidence, baseline, &model, taken.len());
    }
    (model, taken)
}

/// Whether a much weaker and a much stronger effect both fit significantly worse, all else
/// refitted. For a nearly noise-free camera the local curvature is unreliable.
fn strength_is_identified(evidence: &Evidence, model: &FittedModel, index: usize) -> bool {
    with_strength_fixed_aside(&model.hypothesis, index).is_some_and(|aside| {
        aside.into_iter().all(|hypothesis| {
            let there = fit(evidence, hypothesis, MAX_STEPS_AT_FIXED_STRENGTH, 1e-4);
            let (loss, error) = model.cells.gain(&there.cells, CellSet::HeldOut);
            is_significant(loss, error)
        })
    })
}

fn refit_without(
    evidence: &Evidence,
    baseline: &FittedModel,
    model: &FittedModel,
    index: usize,
) -> FittedModel {
    let all = 0..model.hypothesis.effects.len();
    let rest: Vec<usize> = all.filter(|&other| other != index).collect();
    refit_with(evidence, baseline, model, &rest)
}

pub(crate) fn refit_with(
    evidence: &Evidence,
    baseline: &FittedModel,
    model: &FittedModel,
    kept: &[usize],
) -> FittedModel {
    let mut hypothesis = baseline.hypothesis.clone();
    for &index in kept {
        let effect = model.hypothesis.effects[index];
        let start = model.hypothesis.fitted_values(index);
        hypothesis = hypothesis.with_effect_in(effect, &start, model.hypothesis.regions[index]);
    }
    fit_and_refine(evidence, hypothesis, MAX_FINAL_STEPS)
}
