//! Escape from local maxima with a nuisance at its prior bound.
//!
//! A nuisance at its bound may stand in for a similar effect: a junction leak for a photocurrent
//! leak, which is equal where the light has its typical level. The two are nearly collinear, a
//! ridge that gradient steps do not follow. So the nuisance is moved back and the effect's first
//! parameter is scanned.

use super::fitted::FittedModel;
use super::gauss_newton::{score_model, score_models};
use super::local_refinement::{refine_locally, subset_stride};
use crate::diagnose::model::library::CandidateParameter;
use crate::diagnose::{Evidence, Hypothesis, Nuisance};

/// Nuisances that a library effect can be confused with.
const COMPETING_NUISANCES: [Nuisance; 10] = [
    Nuisance::LogRatio,
    Nuisance::LeakHz,
    Nuisance::LogBackgroundOn,
    Nuisance::LogBackgroundOff,
    Nuisance::OffsetUs,
    Nuisance::BlurPx2,
    Nuisance::ShiftX,
    Nuisance::ShiftY,
    Nuisance::RotationDeg,
    Nuisance::ScaleChange,
];

/// Share of its range within which a nuisance counts as at its prior bound.
const BOUND_SHARE: f64 = 0.02;

/// Share within which it is moved back, to this many places.
const NEAR_BOUND_SHARE: f64 = 0.1;
const N_PLACES: u32 = 4;

/// Grid of the first parameter: one octave to either side, then halvings of the step.
const STEPS_PER_OCTAVE: i32 = 8;
const N_HALVINGS: u32 = 4;

/// A refined fit, moved off prior bounds where that is better.
pub(crate) fn refine_off_bounds(evidence: &Evidence, fitted: FittedModel) -> FittedModel {
    let fitted = refine_locally(evidence, fitted);
    let best_of = |part: &Evidence| {
        let elsewhere = moved_off_bounds(&fitted.hypothesis);
        elsewhere
            .into_iter()
            .map(|back| scan_first_parameter(part, &back))
            .reduce(FittedModel::better_of)
    };
    let best = match subset_stride(evidence, &fitted.hypothesis) {
        1 => best_of(evidence),
        subset_stride => best_of(&evidence.thinned(subset_stride))
            .map(|best| score_model(evidence, best.hypothesis)),
    };
    match best.filter(|best| best.training() > fitted.training()) {
        Some(better) => refine_locally(evidence, better),
        None => fitted,
    }
}

/// The hypothesis with each nuisance near its bound moved to several places of its range.
pub(crate) fn moved_off_bounds(hypothesis: &Hypothesis) -> Vec<Hypothesis> {
    if first_parameter(hypothesis).is_none() {
        return Vec::new();
    }
    let near_end = COMPETING_NUISANCES
        .into_iter()
        .filter(|rival| is_within(hypothesis, *rival, NEAR_BOUND_SHARE));
    let led_back = |rival: Nuisance| {
        let [low, high] = hypothesis.ranges[rival as usize];
        (0..N_PLACES).map(move |part| {
            let share = (f64::from(part) + 0.5) / f64::from(N_PLACES);
            hypothesis.with_nuisance(rival, low + (high - low) * share)
        })
    };
    near_end.flat_map(led_back).collect()
}

/// The best value of the last effect's first parameter, all else fixed.
pub(crate) fn scan_first_parameter(evidence: &Evidence, back: &Hypothesis) -> FittedModel {
    let eighth = |n: i32| f64::from(n) / f64::from(STEPS_PER_OCTAVE);
    let all = (-STEPS_PER_OCTAVE..=STEPS_PER_OCTAVE).map(|n| scaled(back, eighth(n))).collect();
    let best = score_models(evidence, all).into_iter().reduce(FittedModel::better_of);
    let begun = best.unwrap_or_else(|| score_model(evidence, back.clone()));
    (1..=N_HALVINGS).fold(begun, |best, halving| {
        let by = eighth(1) * 0.5_f64.powi(halving as i32);
        let nearer = [-by, by].map(|by| scaled(&best.hypothesis, by)).into();
        score_models(evidence, nearer).into_iter().fold(best, FittedModel::better_of)
    })
}

/// That parameter multiplied by a power of two, within its range.
fn scaled(hypothesis: &Hypothesis, doublings: f64) -> Hypothesis {
    let first_parameter = first_parameter(hypothesis);
    let moved =
        first_parameter.map(|(at, parameter)| hypothesis.scaled(at, parameter, doublings.exp2()));
    moved.unwrap_or_else(|| hypothesis.clone())
}

/// The last effect's first parameter with its value index; `None` for an effect that frees
/// nuisances.
fn first_parameter(hypothesis: &Hypothesis) -> Option<(usize, &'static CandidateParameter)> {
    let last = hypothesis.effects.len().checked_sub(1)?;
    let effect = hypothesis.effects[last];
    let parameter = effect.parameters.first().filter(|_| effect.freed.is_empty())?;
    Some((hypothesis.offset_of(last), parameter))
}

/// Whether a nuisance lies at its prior bound.
pub(crate) fn is_at_prior_bound(hypothesis: &Hypothesis, nuisance: Nuisance) -> bool {
    is_within(hypothesis, nuisance, BOUND_SHARE)
}

fn is_within(hypothesis: &Hypothesis, nuisance: Nuisance, share: f64) -> bool {
    let at = nuisance as usize;
    let [low, high] = hypothesis.ranges[at];
    // Absence of the nuisance is a bound too, but no sign.
    let is_none =
        (hypothesis.values[at] - nuisance.neutral().max(low)).abs() <= share * (high - low);
    hypothesis.steps[at] > 0.0 && !is_none && hypothesis.is_at_end(at, share)
}
