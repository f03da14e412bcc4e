//! Where fits with one more effect begin.
//!
//! A nuisance may have taken upon itself what an effect does: a threshold of twice its size, or noise that no
//! camera has. From there a search goes down into another valley, and a start that is right looks wrong. So some
//! begin with what has stood in out of the way, and some with nuisances as they ordinarily are.

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

/// Starts of an effect on top of a model.
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

/// A start on top of a model as it is, and with what may have stood in for the effect out of the way.
fn starts_on_model(
    evidence: &Evidence,
    model: &Hypothesis,
    candidate: &'static CandidateEffect,
    start: &[f64],
) -> impl Iterator<Item = Hypothesis> {
    let plain = model.with(candidate, start);
    let offset_us = (candidate.offset_us)(evidence, start);
    // Without the effect the clocks may have had to stand in for it; with it they need not.
    let us = offset_us.unwrap_or(0.0);
    let is_elsewhere = (us - plain.nuisance(Nuisance::OffsetUs)).abs() > OFFSET_TOLERANCE_US;
    let stated = is_elsewhere && candidate.freed.is_empty();
    let stated = stated.then(|| plain.with_nuisance(Nuisance::OffsetUs, us));
    [Some(plain.clone()), stated]
        .into_iter()
        .flatten()
        .chain(with_nuisance_resets(plain, candidate))
}

/// A model with nuisances as they are at first, at some thresholds. Where the light is led from frame to frame so much
/// of it is unknown that noise and threshold may be nearly anything: events that are a frame late pass for those of a
/// pixel that hardly sees.
fn with_prior_nuisances(evidence: &Evidence, model: &Hypothesis) -> Vec<Hypothesis> {
    if !evidence.facts.is_motion_compensated {
        return Vec::new();
    }
    let begun = nuisances_at_prior(evidence, model, model.effects.len());
    let begun = begun.with_nuisance(Nuisance::LogNoise, START_NOISE.ln());
    START_THRESHOLDS.map(|theta| begun.with_nuisance(Nuisance::LogTheta, theta.ln())).to_vec()
}

/// A hypothesis with its nuisances as they are at first, but those that one of its first effects has freed.
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

/// A start with what may have stood in for the effect out of its way; none where nothing may have.
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

/// Where nuisances stand that an effect frees, if the end of an ordinary range holds one of them: a camera that is all
/// but ideal tells its leak so finely that no other start is near enough.
fn start_at_prior_bound(model: &Hypothesis, candidate: &CandidateEffect) -> Option<Vec<f64>> {
    let freed = || candidate.freed.iter().map(|freed| freed.nuisance);
    let is_held = freed().any(|nuisance| model.is_at_end(nuisance as usize, BOUND_TOLERANCE));
    is_held.then(|| freed().map(|nuisance| model.nuisance(nuisance)).collect())
}

/// The best of a fit as it is and with the values that its last effect may start from: beside nuisances
/// that are fitted, one of them may lie behind a ridge that the fit has not come over.
pub(crate) fn restart_last_effect(evidence: &Evidence, fitted: FittedModel) -> FittedModel {
    let Some(last) = fitted.hypothesis.effects.len().checked_sub(1) else { return fitted };
    let effect = fitted.hypothesis.effects[last];
    if !effect.freed.is_empty() {
        return fitted;
    }
    let begun = score_models(evidence, at_starting_points(evidence, &fitted.hypothesis, last));
    begun.into_iter().fold(fitted, FittedModel::better_of)
}

/// A hypothesis with an effect's own parameters at each of the values that they may start from.
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

/// The same model fitted from where all of it began: nuisances at their ordinary values, the last effect where it
/// may start. Without the effect they have taken what it does upon themselves, all together, and from there a
/// search may go down into another valley with it. `None` where the last effect is a nuisance out of its range.
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
