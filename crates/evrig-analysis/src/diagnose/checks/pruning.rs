//! What is left out of a model again: what later effects replace, what fits at any strength, what buys too little.

use super::acceptance::{is_vague, strength_aside};
use super::accepted_effect::Taken;
use crate::diagnose::Evidence;
use crate::diagnose::fit::cell_scores::{Part, is_enough};
use crate::diagnose::fit::fitted::Fitted;
use crate::diagnose::fit::gauss_newton::{as_it_is, fit};
use crate::diagnose::fit::local_refinement::LAST_STEPS;
use crate::diagnose::fit::local_refinement::fitted_and_polished;
use crate::diagnose::fit::spatial_region::gain_of;
use crate::diagnose::fit::standard_errors::with_errors;

/// So much, nats an event, is bought by nothing that only stands in for something else and leaves no structure.
const VERY_MUCH: f64 = 0.5;

/// Steps of a fit beside a strength that is held aside.
const STEPS_ASIDE: usize = 12;

/// Leaves out what has become idle: an effect that was taken early and that later ones replace. What the `few` pixels
/// of a first fit miss badly is not fitted on all without it: that takes long where pixels are of several kinds. The
/// last one was taken for what it buys beside all the others.
pub(crate) fn prune(
    evidence: &Evidence,
    few: &Evidence,
    baseline: &Fitted,
    mut model: Fitted,
    mut taken: Vec<Taken>,
) -> (Fitted, Vec<Taken>) {
    let n_taken = taken.len();
    let mut index = 0;
    while taken.len() > 1 && index < taken.len() {
        let (is_last, last) = (index + 1 == n_taken, &taken[index]);
        if is_last && is_enough(last.gain, last.error) {
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

/// The model without an effect, where that is not missed.
fn without_idle(
    evidence: &Evidence,
    few: &Evidence,
    baseline: &Fitted,
    model: &Fitted,
    index: usize,
) -> Option<Fitted> {
    if is_missed(few, baseline, model, index) {
        return None;
    }
    let without = refit_without(evidence, baseline, model, index);
    let (loss, error) = gain_of(evidence, model, index, &without);
    (!is_enough(loss, error)).then_some(without)
}

/// Whether these pixels are foretold worse without an effect, fitted anew to them alone, by twice what a name takes.
fn is_missed(few: &Evidence, baseline: &Fitted, model: &Fitted, index: usize) -> bool {
    let here = as_it_is(few, model.hypothesis.clone());
    let without = refit_without(few, baseline, model, index);
    let (loss, error) = gain_of(few, &here, index, &without);
    is_enough(0.5 * loss, error)
}

/// Leaves out effects that buy something at any strength, the last taken first; the model comes back with its errors.
/// What buys very much is left to the judgement by structure.
pub(crate) fn leave_out_vague(
    evidence: &Evidence,
    baseline: &Fitted,
    mut model: Fitted,
    mut taken: Vec<Taken>,
) -> (Fitted, Vec<Taken>) {
    loop {
        let known = with_errors(evidence, model.clone());
        let fits_anywhere = |&index: &usize| {
            taken[index].gain < VERY_MUCH
                && is_vague(&known, index)
                && !tells_strength(evidence, &known, index)
        };
        let Some(vague) = (0..taken.len()).rev().find(fits_anywhere) else {
            return (known, taken);
        };
        model = refit_without(evidence, baseline, &model, vague);
        taken.remove(vague);
    }
}

/// Leaves out, from the last taken on, what buys less than `bar`, nats an event.
pub(crate) fn leave_out_below(
    evidence: &Evidence,
    baseline: &Fitted,
    mut model: Fitted,
    mut taken: Vec<Taken>,
    bar: f64,
) -> (Fitted, Vec<Taken>) {
    while taken.last().is_some_and(|last| last.gain < bar) {
        taken.pop();
        model = refit_without(evidence, baseline, &model, taken.len());
    }
    (model, taken)
}

/// Whether the recording is foretold worse with an effect much weaker and with it much stronger, all else
/// fitted anew. Errors claim less where a likelihood as sharp as an ideal camera's makes the curvature
/// between two values a matter of chance.
fn tells_strength(evidence: &Evidence, model: &Fitted, index: usize) -> bool {
    strength_aside(&model.hypothesis, index).is_some_and(|aside| {
        aside.into_iter().all(|hypothesis| {
            let there = fit(evidence, hypothesis, STEPS_ASIDE, 1e-4);
            let (loss, error) = model.cells.gain(&there.cells, Part::HeldOut);
            is_enough(loss, error)
        })
    })
}

/// The model without one of its effects.
fn refit_without(evidence: &Evidence, baseline: &Fitted, model: &Fitted, index: usize) -> Fitted {
    let all = 0..model.hypothesis.effects.len();
    let rest: Vec<usize> = all.filter(|&other| other != index).collect();
    refit_with(evidence, baseline, model, &rest)
}

/// The model with only some of its effects.
pub(crate) fn refit_with(
    evidence: &Evidence,
    baseline: &Fitted,
    model: &Fitted,
    kept: &[usize],
) -> Fitted {
    let mut hypothesis = baseline.hypothesis.clone();
    for &index in kept {
        let effect = model.hypothesis.effects[index];
        let start = model.hypothesis.fitted_values(index);
        hypothesis = hypothesis.with_in(effect, &start, model.hypothesis.regions[index]);
    }
    fitted_and_polished(evidence, hypothesis, LAST_STEPS)
}
