//! One round of the search: every effect of the library refitted on top of what is known.

use super::bound_escape::{is_at_prior_bound, refine_off_bounds};
use super::cell_scores::CellSet;
use super::fitted::FittedModel;
use super::gauss_newton::{fit, improve, score_model, score_models};
use super::local_refinement::{MAX_FINAL_STEPS, fit_coarse_to_fine, refine_locally};
use super::multistart::{
    MAX_FIRST_STEPS, MAX_STARTS, refit_from_prior, restart_last_effect, starting_points_on,
};
use super::spatial_region::{choose_region, effect_gain, start_in_region};
use crate::diagnose::model::library::{CandidateEffect, LIBRARY};
use crate::diagnose::sensor_wide;
use crate::diagnose::{Evidence, Hypothesis, Nuisance, UntestableEffect};
use evrig_core::effect_id::EffectId;

const MAX_STEPS_ON_ALL_PIXELS: usize = 6;

/// Gain per step, nats per event, for which a fit on all pixels goes on, and for how many steps.
const MIN_STEP_GAIN: f64 = 0.01;
const MAX_EXTRA_STEPS: usize = 12;

/// Why single pixels cannot be tested under a saturated readout.
const SATURATED_READOUT: &str = "events wait for a readout that is never free: record fewer at a time, with slower motion or a plainer target";

/// Training gain, nats per event, below which an effect is not fitted further.
const MIN_TRAINING_GAIN: f64 = 0.01;

/// Effects fitted on the subset, and then on all pixels (work budget).
const MAX_FITTED_ON_SUBSET: usize = 8;

const MAX_FITTED_ON_ALL: usize = 4;

/// Reductions of log noise that are tried, and gain over the improved tiles for which a region is
/// searched.
const NOISE_REDUCTIONS_LOG: [f64; 2] = [0.8, 1.6];
const MIN_REGION_GAIN: f64 = 0.1;

/// What an effect buys on top of a model.
#[derive(Debug, Clone, Copy)]
pub struct EffectGain {
    /// The effect.
    pub id: EffectId,
    /// Nats an event on training cells.
    pub training: f64,
    /// Nats an event on held-out cells.
    pub held_out: f64,
    /// Standard error of the held-out gain, from its scatter over cells.
    pub error: f64,
}

/// An effect's gain and the model with it.
#[derive(Debug, Clone)]
pub(crate) struct TrialFit {
    pub(crate) gain: EffectGain,
    pub(crate) fitted: FittedModel,
    /// Whether it was fitted on all pixels, and not on few.
    pub(crate) uses_all_pixels: bool,
    /// Whether its fit was gone on with until it stood still.
    pub(crate) has_converged: bool,
}

impl TrialFit {
    /// The fit gone on with until it stands still.
    pub(crate) fn converged(self, evidence: &Evidence, model: &FittedModel) -> Self {
        let has_own_values = model.hypothesis.pixel_mixture().is_continuous();
        let converge = if has_own_values { converge_with_pinned_strata } else { converge };
        let fitted = converge(evidence, model, self.fitted);
        Self { fitted, uses_all_pixels: true, has_converged: true, ..self }
            .measured_against(evidence, model)
    }

    /// Whether the effect frees a nuisance of which `model`, without it, has as much as is ordinary: it may ask for
    /// more, and be none of the model's nuisances but a finding.
    pub(crate) fn is_limited_by_prior(&self, model: &Hypothesis) -> bool {
        let effect = self.fitted.hypothesis.effects.last();
        effect.into_iter().flat_map(|effect| effect.freed).any(|freed| {
            let (value, [low, high]) = (model.nuisance(freed.nuisance), freed.range);
            is_at_prior_bound(model, freed.nuisance) && low < value && value < high
        })
    }

    /// The same fit measured against a better model without the effect. A first fit on some of the
    /// pixels does not compare and keeps its gain.
    pub(crate) fn measured_against(mut self, evidence: &Evidence, model: &FittedModel) -> Self {
        if self.uses_all_pixels {
            self.gain.training = self.fitted.cells.gain(&model.cells, CellSet::Training).0;
            let last = model.hypothesis.effects.len();
            (self.gain.held_out, self.gain.error) =
                effect_gain(evidence, &self.fitted, last, model);
        }
        self
    }
}

/// Why an effect is not in the question. Where the readout `is_saturated` none is that acts on single pixels.
pub(crate) fn cannot_judge(evidence: &Evidence, is_saturated: bool) -> Vec<UntestableEffect> {
    let held_up = || is_saturated.then(|| SATURATED_READOUT.to_owned());
    let because = |id: EffectId| match LIBRARY.iter().find(|candidate| candidate.id == id) {
        Some(candidate) => (candidate.requires)(evidence).err().or_else(held_up),
        None if LIBRARY.iter().any(|candidate| candidate.inseparable.contains(&id)) => held_up(),
        None => sensor_wide::testable(evidence, id).err(),
    };
    let all = EffectId::ALL.iter().copied();
    all.filter_map(|id| because(id).map(|because| UntestableEffect { id, because })).collect()
}

/// Tries every effect that is not in `model` and can be judged. `few` is the same evidence with
/// fewer pixels. Effects come sorted by what they buy on held-out cells.
///
/// All starts of all effects are scored first, on few pixels; the best of each effect are moved one
/// step together with the nuisances; those that then promise most are fitted on few pixels, and the
/// best of these on all.
pub(crate) fn scan_library(
    evidence: &Evidence,
    few: &Evidence,
    model: &FittedModel,
    progress: &mut dyn FnMut(&str),
) -> Vec<TrialFit> {
    let here = with_pinned_strata(few, model);
    let sharp = with_less_noise(few, &here);
    let mut begun = Vec::new();
    for candidate in testable_candidates(evidence, model) {
        progress(candidate.id.as_str());
        let sharp =
            sharp.iter().flat_map(|sharp| starts_with_less_noise(evidence, few, sharp, candidate));
        if let Some(first) = first_step(evidence, few, &here, candidate, sharp) {
            begun.push((candidate, first));
        }
    }
    begun.sort_by(|a, b| b.1.training().total_cmp(&a.1.training()));
    for (candidate, fitted) in begun.iter_mut().take(MAX_FITTED_ON_SUBSET) {
        progress(candidate.id.as_str());
        *fitted = fit(few, fitted.hypothesis.clone(), MAX_FIRST_STEPS, 1e-4);
    }
    begun.sort_by(|a, b| b.1.training().total_cmp(&a.1.training()));
    let known =
        here.hypothesis.pinned_strata.is_some().then(|| with_pinned_strata(evidence, model));
    let mut all: Vec<TrialFit> = begun
        .into_iter()
        .enumerate()
        .map(|(rank, (candidate, fitted))| {
            let gained = fitted.training() - here.training();
            let is_worth_it = rank < MAX_FITTED_ON_ALL && gained > MIN_TRAINING_GAIN;
            let whole = if is_worth_it {
                progress(candidate.id.as_str());
                fit_on_all_pixels(evidence, model, known.as_ref(), fitted.hypothesis.clone())
            } else {
                None
            };
            let uses_all_pixels = whole.is_some();
            let mut fitted = whole.unwrap_or(fitted);
            fitted.hypothesis = fitted.hypothesis.unpin_strata(&model.hypothesis);
            let against = if uses_all_pixels { model } else { &here };
            let (training, _) = fitted.cells.gain(&against.cells, CellSet::Training);
            let last = model.hypothesis.effects.len();
            let (held_out, error) = effect_gain(evidence, &fitted, last, against);
            let gain = EffectGain { id: candidate.id, training, held_out, error };
            TrialFit { gain, fitted, uses_all_pixels, has_converged: false }
        })
        .collect();
    sort_by_gain(&mut all);
    all
}

/// An effect that promised much on few pixels, fitted on all. None where it buys nothing there with pixels of unknown
/// kind taken to be as in `known`: scoring them for all kinds is many times the work.
fn fit_on_all_pixels(
    evidence: &Evidence,
    model: &FittedModel,
    known: Option<&FittedModel>,
    start: Hypothesis,
) -> Option<FittedModel> {
    let Some(known) = known else {
        let begun = fit_coarse_to_fine(evidence, start, MAX_STEPS_ON_ALL_PIXELS, 1e-4);
        return Some(improve(evidence, begun, MAX_EXTRA_STEPS, MIN_STEP_GAIN));
    };
    let there =
        fit(evidence, start.pin_strata_as(&known.hypothesis), MAX_STEPS_ON_ALL_PIXELS, 1e-4);
    (there.training() - known.training() > MIN_TRAINING_GAIN).then_some(())?;
    let there = score_model(evidence, there.hypothesis.unpin_strata(&model.hypothesis));
    Some(improve(evidence, there, MAX_STEPS_ON_ALL_PIXELS, MIN_STEP_GAIN))
}

/// A fit with one more effect than `model` gone on with until it stands still.
fn converge(evidence: &Evidence, model: &FittedModel, begun: FittedModel) -> FittedModel {
    let fresh = refit_from_prior(evidence, &begun.hypothesis);
    let start = restart_last_effect(evidence, begun).hypothesis;
    let begun = fit_coarse_to_fine(evidence, start, MAX_FINAL_STEPS, 1e-5);
    let there = refine_off_bounds(evidence, fresh.into_iter().fold(begun, FittedModel::better_of));
    choose_region(evidence, model, there)
}

/// The same where pixels have each a value of their own: with each taken to have its likeliest, which is scored once
/// where all are many times the work, and then once more with values that are not known again.
fn converge_with_pinned_strata(
    evidence: &Evidence,
    model: &FittedModel,
    begun: FittedModel,
) -> FittedModel {
    let start = begun.hypothesis.clone().pin_strata(evidence);
    let without = model.hypothesis.clone().pin_strata_as(&start);
    let without = fit(evidence, without, MAX_FINAL_STEPS, 1e-4);
    let there = converge(evidence, &without, score_model(evidence, start));
    let there = score_model(evidence, there.hypothesis.unpin_strata(&model.hypothesis));
    refine_locally(evidence, improve(evidence, begun.better_of(there), MAX_FINAL_STEPS, 1e-4))
}

/// Sorts by what is bought on held-out cells, fits on all pixels first: what was fitted on few is none to take.
pub(crate) fn sort_by_gain(tried: &mut [TrialFit]) {
    tried.sort_by(|a, b| {
        let objection_to_all = b.uses_all_pixels.cmp(&a.uses_all_pixels);
        objection_to_all.then(b.gain.held_out.total_cmp(&a.gain.held_out))
    });
}

/// The model on few pixels, those of unknown kind taken to be of their likeliest. For kinds that are known the
/// best values are others: what they gain is no effect's, so that they are looked for to the end.
fn with_pinned_strata(few: &Evidence, model: &FittedModel) -> FittedModel {
    let here = score_model(few, model.hypothesis.clone().pin_strata(few));
    if here.hypothesis.pinned_strata.is_some() {
        improve(few, here, MAX_FINAL_STEPS, 1e-4)
    } else {
        here
    }
}

/// The model with less noise, where that foretells a part of the pixels much better: an effect in the other
/// part has passed for noise everywhere.
fn with_less_noise(few: &Evidence, model: &FittedModel) -> Option<FittedModel> {
    let noise = model.hypothesis.nuisance(Nuisance::LogNoise);
    let less = NOISE_REDUCTIONS_LOG
        .map(|less| model.hypothesis.with_nuisance(Nuisance::LogNoise, noise - less));
    let scored = score_models(few, less.to_vec()).into_iter().map(|sharp| {
        (
            sharp.cells.gain_over_improved_tiles(&model.cells, CellSet::Training, few.blocks.n()),
            sharp,
        )
    });
    let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(gain, _)| *gain > MIN_REGION_GAIN).map(|(_, sharp)| sharp)
}

/// An effect's starts in the part of the picture that a model with less noise foretells worse for want of it.
fn starts_with_less_noise(
    evidence: &Evidence,
    few: &Evidence,
    sharp: &FittedModel,
    candidate: &'static CandidateEffect,
) -> Vec<FittedModel> {
    let starts = (candidate.starting_points)(evidence);
    let starts = starts.iter().map(|start| sharp.hypothesis.with(candidate, start)).collect();
    let begun = score_models(few, starts);
    begun.iter().filter_map(|start| start_in_region(few, sharp, start)).collect()
}

/// Effects that the model has not and that can be judged.
fn testable_candidates(evidence: &Evidence, model: &FittedModel) -> Vec<&'static CandidateEffect> {
    let effects = &model.hypothesis.effects;
    let has_mixture = effects.iter().any(|effect| effect.mixture.is_some());
    LIBRARY
        .into_iter()
        .filter(|candidate| effects.iter().all(|effect| effect.id != candidate.id))
        .filter(|candidate| !(has_mixture && candidate.mixture.is_some()))
        .filter(|candidate| (candidate.requires)(evidence).is_ok())
        .collect()
}

/// The best of an effect's starts behind one step; `model` is scored on few pixels. `None` for an effect
/// without any.
pub(crate) fn first_step(
    evidence: &Evidence,
    few: &Evidence,
    model: &FittedModel,
    candidate: &'static CandidateEffect,
    sharp: impl Iterator<Item = FittedModel>,
) -> Option<FittedModel> {
    let mut begun = score_models(few, starting_points_on(evidence, &model.hypothesis, candidate));
    // Tile by tile a gain is the effect's where nothing else has changed.
    let same_nuisances = |start: &&FittedModel| {
        let is_freed = |i: usize| candidate.freed.iter().any(|freed| freed.nuisance as usize == i);
        let pairs = start.hypothesis.values.iter().zip(&model.hypothesis.values);
        pairs.enumerate().all(|(i, (there, here))| there == here || is_freed(i))
    };
    let in_parts: Vec<FittedModel> = begun
        .iter()
        .filter(same_nuisances)
        .filter_map(|start| start_in_region(few, model, start))
        .collect();
    begun.extend(in_parts.into_iter().chain(sharp));
    begun.sort_by(|a, b| b.training().total_cmp(&a.training()));
    // A parameter that keeps the value it starts with parts the starts: the best of each part. So does
    // whether nuisances begin elsewhere: what that buys shows only behind the step.
    let own = model.hypothesis.values.len();
    let part = |fitted: &FittedModel| -> (bool, Vec<u64>) {
        let values = fitted.hypothesis.values.iter().zip(&fitted.hypothesis.steps).skip(own);
        let kept = values.filter(|(_, step)| **step == 0.0).map(|(value, _)| value.to_bits());
        (same_nuisances(&fitted), kept.collect())
    };
    let mut seen: Vec<((bool, Vec<u64>), usize)> = Vec::new();
    begun.retain(|fitted| {
        let part = part(fitted);
        match seen.iter_mut().find(|(known, _)| *known == part) {
            Some((_, n)) => {
                *n += 1;
                *n <= MAX_STARTS
            }
            None => {
                seen.push((part, 1));
                true
            }
        }
    });
    begun
        .into_iter()
        .map(|fitted| improve(few, fitted, 2, 1e-4))
        .max_by(|a, b| a.training().total_cmp(&b.training()))
}
