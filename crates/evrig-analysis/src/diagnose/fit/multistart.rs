//! Starting points of fits with one more effect.
//!
//! Nuisances may have absorbed an effect: a threshold of twice its size, or implausible noise.
//! From there a search finds another local maximum. So some starts reset such nuisances, and some
//! put all nuisances at their prior values.

use super::fitted::FittedModel;
use super::gauss_newton::{improve, score_models};
use super::local_refinement::{MAX_FINAL_STEPS, fit_coarse_to_fine, pixel_subset};
use crate::diagnose::model::library::CandidateEffect;
use crate::diagnose::{Evidence, Hypothesis, Nuisance};

/// Steps of a first fit on the subset.
pub(crate) const MAX_FIRST_STEPS: usize = 4;

/// Starting points that are moved by a step.
pub(crate) const MAX_STARTS: usize = 2;

const OFFSET_TOLERANCE_US: f64 = 50.0;

/// Share of its range within which a nuisance counts as at its bound.
const BOUND_TOLERANCE: f64 = 1e-6;

/// Thresholds (log intensity) and noise (thresholds, at white) of starts at the prior.
const START_THRESHOLDS: [f64; 3] = [0.2, 0.4, 0.8];
const START_NOISE: f64 = 0.2;

/// Starting points of an effect on top of a model.
pub(crate) fn starting_points_on(
    evidence: &Evidence,
    model: &Hypothesis,
    candidate: &'static CandidateEffect,
) -> Vec<Hypothesis> {
    let own = (candidate.starting_points)(evidence);
    let with_prior_nuisances = with_prior_nuisances(evidence, model);
    let mut starts = Vec::new();
    for start in own.iter().chain(&start_at_prior_bound(model, candidate)) {
        starts.extend(starts_on_model(evidence, model, candidate, start));
    }
    for start in &own {
        starts.extend(with_prior_nuisances.iter().map(|begun| begun.with(candidate, start)));
    }
    starts
}

/// A start on the model as it is, and with nuisances reset that can imitate the effect.
fn starts_on_model(
    evidence: &Evidence,
    model: &Hypothesis,
    candidate: &'static CandidateEffect,
    start: &[f64],
) -> impl Iterator<Item = Hypothesis> {
    let plain = model.with(candidate, start);
    let offset_us = (candidate.offset_us)(evidence, start);
    // Without the effect the clock offset may have stood in for it.
    let us = offset_us.unwrap_or(0.0);
    let is_elsewhere = (us - plain.nuisance(Nuisance::OffsetUs)).abs() > OFFSET_TOLERANCE_US;
    let stated = is_elsewhere && candidate.freed.is_empty();
    let stated = stated.then(|| plain.with_nuisance(Nuisance::OffsetUs, us));
    [Some(plain.clone()), stated]
        .into_iter()
        .flatten()
        .chain(with_nuisance_resets(plain, candidate))
}

/// Models with prior nuisances and several thresholds. Motion-compensated interpolation leaves so
/// much unknown that noise and threshold may be far off: events delayed by a frame imitate an
/// insensitive pixel.
fn with_prior_nuisances(evidence: &Evidence, model: &Hypothesis) -> Vec<Hypothesis> {
    if !evidence.facts.is_motion_compensated {
        return Vec::new();
    }
    let begun = nuisances_at_prior(evidence, model, model.effects.len());
    let begun = begun.with_nuisance(Nuisance::LogNoise, START_NOISE.ln());
    START_THRESHOLDS.map(|theta| begun.with_nuisance(Nuisance::LogTheta, theta.ln())).to_vec()
}

/// A hypothesis with nuisances at their prior values, but for those that the first effects free.
fn nuisances_at_prior(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    n_effects: usize,
) -> Hypothesis {
    let is_of_an_effect =
        |at: usize| (0..n_effects).any(|index| hypothesis.value_indices(index).contains(&at));
    let own = Nuisance::ALL.into_iter().filter(|n| !is_of_an_effect(*n as usize));
    own.fold(hypothesis.clone(), |begun, nuisance| {
        begun.with_nuisance(nuisance, nuisance.prior(&evidence.facts).start)
    })
}

/// A start with competing nuisances reset.
fn with_nuisance_resets(
    start: Hypothesis,
    candidate: &'static CandidateEffect,
) -> impl Iterator<Item = Hypothesis> {
    let theta_raises =
        if candidate.nuisance_resets.is_empty() { &[] } else { candidate.theta_raises };
    theta_raises.iter().map(move |raise| {
        let log_theta = start.nuisance(Nuisance::LogTheta) + raise;
        let raised = start.with_nuisance(Nuisance::LogTheta, log_theta);
        let freed = |other: Hypothesis, &(nuisance, value): &(Nuisance, f64)| {
            other.with_nuisance(nuisance, value)
        };
        candidate.nuisance_resets.iter().fold(raised, freed)
    })
}

/// The model's values of the nuisances that an effect frees, if one lies at its prior bound: for a
/// nearly noise-free camera no other start is near enough.
fn start_at_prior_bound(model: &Hypothesis, candidate: &CandidateEffect) -> Option<Vec<f64>> {
    let freed = || candidate.freed.iter().map(|freed| freed.nuisance);
    let is_held = freed().any(|nuisance| model.is_at_end(nuisance as usize, BOUND_TOLERANCE));
    is_held.then(|| freed().map(|nuisance| model.nuisance(nuisance)).collect())
}

/// The best of a fit and of restarts of its last effect's parameters.
pub(crate) fn restart_last_effect(evidence: &Evidence, fitted: FittedModel) -> FittedModel {
    let Some(last) = fitted.hypothesis.effects.len().checked_sub(1) else { return fitted };
    let effect = fitted.hypothesis.effects[last];
    if !effect.freed.is_empty() {
        return fitted;
    }
    let begun = score_models(evidence, at_starting_points(evidence, &fitted.hypothesis, last));
    begun.into_iter().fold(fitted, FittedModel::better_of)
}

/// A hypothesis with an effect's parameters at each starting point.
fn at_starting_points(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    index: usize,
) -> Vec<Hypothesis> {
    let at = hypothesis.offset_of(index);
    let begun = |start: Vec<f64>| {
        let mut begun = hypothesis.clone();
        begun.values[at..at + start.len()].copy_from_slice(&start);
        begun
    };
    (hypothesis.effects[index].starting_points)(evidence).into_iter().map(begun).collect()
}

/// The same model fitted from prior nuisances and the last effect's starting points, since
/// nuisances fitted without the effect may lead to another local maximum. `None` where the last
/// effect frees nuisances.
pub(crate) fn refit_from_prior(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
) -> Option<FittedModel> {
    let last = hypothesis.effects.len().checked_sub(1)?;
    let effect = hypothesis.effects[last];
    if !effect.freed.is_empty() {
        return None;
    }
    let ordinary = nuisances_at_prior(evidence, hypothesis, last);
    let theta = hypothesis.nuisance(Nuisance::LogTheta);
    let at_theta = ordinary.with_nuisance(Nuisance::LogTheta, theta);
    let both = [ordinary, at_theta];
    let starts = both.iter().flat_map(|begun| at_starting_points(evidence, begun, last)).collect();
    let few = pixel_subset(evidence, hypothesis);
    let there = few.as_ref().unwrap_or(evidence);
    let mut scored = score_models(there, starts);
    scored.sort_by(|a, b| b.training().total_cmp(&a.training()));
    scored.truncate(MAX_STARTS);
    let moved = scored.into_iter().map(|begun| improve(there, begun, MAX_FIRST_STEPS, 1e-4));
    let best = moved.reduce(FittedModel::better_of)?;
    Some(fit_coarse_to_fine(evidence, best.hypothesis, MAX_FINAL_STEPS, 1e-4))
}
