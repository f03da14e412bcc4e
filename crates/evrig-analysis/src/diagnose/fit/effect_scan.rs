//! One round of the search: every library effect fitted on top of a model.

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
const SATURATED_READOUT: &str = "the readout is saturated: record fewer events per second, with \
     slower motion or less texture";

/// Training gain, nats per event, below which an effect is not fitted further.
const MIN_TRAINING_GAIN: f64 = 0.01;

/// Effects fitted on the subset, and then on all pixels (work budget).
const MAX_FITTED_ON_SUBSET: usize = 8;

const MAX_FITTED_ON_ALL: usize = 4;

/// Reductions of log noise that are tried, and gain over the improved tiles for which a region is
/// searched.
const NOISE_REDUCTIONS_LOG: [f64; 2] = [0.8, 1.6];
const MIN_REGION_GAIN: f64 = 0.1;

/// Gain of an effect over a model.
#[derive(Debug, Clone, Copy)]
pub struct EffectGain {
    /// The effect.
    pub id: EffectId,
    /// On training cells, nats per event.
    pub training: f64,
    /// On held-out cells, nats per event.
    pub held_out: f64,
    /// Standard error of the held-out gain, from the scatter over cells.
    pub error: f64,
}

/// A model with one more effect.
#[derive(Debug, Clone)]
pub(crate) struct TrialFit {
    pub(crate) gain: EffectGain,
    pub(crate) fitted: FittedModel,
    /// Whether it was fitted on all pixels.
    pub(crate) uses_all_pixels: bool,
    /// Whether it was fitted to convergence.
    pub(crate) has_converged: bool,
}

impl TrialFit {
    /// The same effect fitted to convergence.
    pub(crate) fn converged(self, evidence: &Evidence, model: &FittedModel) -> Self {
        let has_own_values = model.hypothesis.pixel_mixture().is_continuous();
        let converge = if has_own_values { converge_with_pinned_strata } else { converge };
        let fitted = converge(evidence, model, self.fitted);
        Self { fitted, uses_all_pixels: true, has_converged: true, ..self }
            .measured_against(evidence, model)
    }

    /// Whether the effect frees a nuisance that lies at its prior bound in `model`.
    pub(crate) fn is_limited_by_prior(&self, model: &Hypothesis) -> bool {
        let effect = self.fitted.hypothesis.effects.last();
        effect.into_iter().flat_map(|effect| effect.freed).any(|freed| {
            let (value, [low, high]) = (model.nuisance(freed.nuisance), freed.range);
            is_at_prior_bound(model, freed.nuisance) && low < value && value < high
        })
    }

    /// The gain over a better model without the effect. First fits on a subset are not comparable
    /// and keep their gain.
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

/// Effects that cannot be tested. Under a saturated readout these include all effects on single
/// pixels.
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

/// Fits every testable effect that is not in `model`; `few` is a subset of the pixels. Results are
/// sorted by held-out gain.
///
/// All starting points of all effects are scored on the subset. The best of each effect are moved
/// by a step together with the nuisances; the most promising effects are fitted on the subset, and
/// the best of these on all pixels.
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

/// An effect fitted on all pixels; `None` if it gains nothing there with the pixel strata of
/// `known`, which is much less work than unknown strata.
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

/// Fits the last effect to convergence.
fn converge(evidence: &Evidence, model: &FittedModel, begun: FittedModel) -> FittedModel {
    let fresh = refit_from_prior(evidence, &begun.hypothesis);
    let start = restart_last_effect(evidence, begun).hypothesis;
    let begun = fit_coarse_to_fine(evidence, start, MAX_FINAL_STEPS, 1e-5);
    let there = refine_off_bounds(evidence, fresh.into_iter().fold(begun, FittedModel::better_of));
    choose_region(evidence, model, there)
}

/// The same with pinned pixel strata, which is much less work, and then with unknown strata again.
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

/// Sorts by held-out gain, fits on all pixels first.
pub(crate) fn sort_by_gain(tried: &mut [TrialFit]) {
    tried.sort_by(|a, b| {
        let objection_to_all = b.uses_all_pixels.cmp(&a.uses_all_pixels);
        objection_to_all.then(b.gain.held_out.total_cmp(&a.gain.held_out))
    });
}

/// The model on the subset with pinned pixel strata. The optimum then differs and is fitted first,
/// so that effects are not credited with it.
fn with_pinned_strata(few: &Evidence, model: &FittedModel) -> FittedModel {
    let here = score_model(few, model.hypothesis.clone().pin_strata(few));
    if here.hypothesis.pinned_strata.is_some() {
        improve(few, here, MAX_FINAL_STEPS, 1e-4)
    } else {
        here
    }
}

/// The model with less noise, if that improves part of the tiles clearly: an effect in the other
/// part was fitted as noise everywhere.
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

/// Starting points in the region that a model with less noise predicts worse.
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

/// Effects that can be tested and are not in the model.
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

/// The best starting point of an effect after a step, on the subset; `None` for an effect without
/// one.
pub(crate) fn first_step(
    evidence: &Evidence,
    few: &Evidence,
    model: &FittedModel,
    candidate: &'static CandidateEffect,
    sharp: impl Iterator<Item = FittedModel>,
) -> Option<FittedModel> {
    let mut begun = score_models(few, starting_points_on(evidence, &model.hypothesis, candidate));
    // A gain per tile belongs to the effect only if nothing else has changed.
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
    // The best starts are kept per value of a fixed parameter, and with and without changed
    // nuisances, which show their gain only after the step.
    let own = model.hypothesis.values.len();
    let part = |fitted: &FittedModel| -> (bool, Vec<u64>) {
        let values = fitted.hypothesis.values.iter().zip(&fitted.hypothesis.steps).skip(own);
        let kept = values.filter(|(_, step)| **step == 0.0).map(|(value, _)| value.to_bits());
        (same_nuisances(&fitted), kept.collect())
    };
    let mut counts: Vec<((bool, Vec<u64>), usize)> = Vec::new();
    begun.retain(|fitted| {
        let part = part(fitted);
        match counts.iter_mut().find(|(known, _)| *known == part) {
            Some((_, n)) => {
                *n += 1;
                *n <= MAX_STARTS
            }
            None => {
                counts.push((part, 1));
                true
            }
        }
    });
    begun
        .into_iter()
        .map(|fitted| improve(few, fitted, 2, 1e-4))
        .max_by(|a, b| a.training().total_cmp(&b.training()))
}
