//! The forward selection of effects: baseline, one effect at a time, null distribution, tests.

use crate::diagnose::checks::accepted_effect::AcceptedEffect;
use crate::diagnose::checks::effect_review::{EffectReview, ReviewedModel};
use crate::diagnose::checks::null_distribution;
use crate::diagnose::checks::pruning::{
    remove_effects_below, remove_replaced_effects, remove_unidentified_effects,
};
use crate::diagnose::checks::split_half::split_half_fits;
use crate::diagnose::checks::two_sample_test::test_structure;
use crate::diagnose::fit::cell_scores::{
    CellSet, MIN_GAIN_NATS_PER_EVENT, MIN_GAIN_STANDARD_ERRORS, is_significant, is_suggestive,
};
use crate::diagnose::fit::effect_scan::{EffectGain, TrialFit, scan_library, sort_by_gain};
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::fit::gauss_newton::{fit, improve, score_model, score_models};
use crate::diagnose::fit::local_refinement::fit_and_refine;
use crate::diagnose::fit::spatial_region::effect_gain;
use crate::diagnose::report::conclusion::{SearchOutcome, conclude};
use crate::diagnose::report::departure::{Departure, as_effects};
use crate::diagnose::report::heat_map::{HeatMap, heat_maps};
use crate::diagnose::sensor_wide::{SensorWideStatistics, sensor_wide_statistics};
use crate::diagnose::{
    CompetingHypothesis, Diagnosis, DiagnosisOptions, Evidence, Hypothesis, Nuisance, NullReport,
    RejectedEffect,
};
use evrig_core::geometry::Rectangle;

/// A competitor with this share of the best gain is fitted to convergence.
const MIN_COMPETITOR_GAIN_SHARE: f64 = 0.4;

/// Below this best gain, effects limited by a prior bound are fitted to convergence too.
const LOW_GAIN_NATS_PER_EVENT: f64 = 0.1;

/// Number of effects fitted to convergence per round, the best included (work budget).
const MAX_CONVERGED_COMPETITORS: usize = 3;

/// Optimizer steps from the optimum on the coarse grid to that on the fine one.
const MAX_STEPS_ON_FINE_GRID: usize = 12;

/// Events on which first fits are made (work budget).
const SUBSET_EVENTS: usize = 6_000;

/// Starting clock offsets to either side of zero.
const N_OFFSET_STARTS: i32 = 5;

/// A diagnosis with its models.
#[derive(Debug, Clone)]
pub struct DiagnosisResult {
    /// The result.
    pub diagnosis: Diagnosis,
    /// Nuisances alone.
    pub baseline: Hypothesis,
    /// With the named effects; the baseline where none is named.
    pub model: Hypothesis,
    /// Maps of the misfit of both models.
    pub heat: Vec<HeatMap>,
}

/// Runs the diagnosis: which effects of the library does the recording show beyond the baseline?
///
/// `departures` are differences between frames and statement that the evidence's signal includes.
/// `progress` receives the name of each step.
#[must_use]
pub fn diagnose(
    evidence: &Evidence,
    departures: &[Departure],
    options: &DiagnosisOptions,
    progress: &mut dyn FnMut(&str),
) -> DiagnosisResult {
    let SensorWideStatistics { departures: counted, rest, is_saturated, isolated_events } =
        sensor_wide_statistics(evidence);
    let evidence = rest.as_ref().unwrap_or(evidence);
    let max_effects = if is_saturated { 0 } else { options.max_effects };
    progress("baseline");
    let few = evidence.thinned((evidence.n_events() / SUBSET_EVENTS).max(2));
    let baseline = fit_baseline(evidence, &few);
    let (baseline, model, taken, unsure) =
        accept_effects(evidence, &few, baseline, max_effects, progress);
    // All later fits use the fine grid, but for the removal of replaced effects.
    let baseline = baseline.with_fine_grid(true);
    progress("two-sample test");
    let before = test_structure(evidence, &baseline, options.seed);
    let review = EffectReview {
        evidence,
        baseline: &baseline,
        before: before.as_ref(),
        null: &[],
        has_suggestive_effect: unsure.is_some(),
        misses_isolated_events: isolated_events.is_some(),
        seed: options.seed,
    };
    let ReviewOutcome { reviewed, reach, null } =
        review_found(&review, &few, (model, taken), options, progress);
    let ReviewedModel { model, taken, adequacy, after, mut rejected_effects } = reviewed;
    rejected_effects.extend(unsure);
    let (model, taken) = match model.errors {
        Some(_) => (model, taken),
        None => remove_unidentified_effects(evidence, &baseline, model, taken),
    };
    progress("halves");
    let split_half =
        if taken.is_empty() { Vec::new() } else { split_half_fits(evidence, &baseline, &model) };
    let departed = as_effects(evidence, departures.iter().chain(&counted), &baseline);
    let reached = SearchOutcome {
        taken,
        adequacy,
        before,
        after,
        reach,
        rejected_effects,
        split_half,
        null,
        is_saturated,
        isolated_events,
        departed,
    };
    DiagnosisResult {
        diagnosis: conclude(evidence, &baseline, &model, reached),
        heat: heat_maps(evidence, [&baseline, &model]),
        baseline: baseline.hypothesis,
        model: model.hypothesis,
    }
}

struct ReviewOutcome {
    reviewed: ReviewedModel,
    reach: f64,
    null: NullReport,
}

/// Removes replaced, chance-level and unidentified effects and tests the others. A model that
/// explains nothing is rejected at once, since these tests take as long as the search.
fn review_found(
    review: &EffectReview<'_>,
    few: &Evidence,
    (model, taken): (FittedModel, Vec<AcceptedEffect>),
    options: &DiagnosisOptions,
    progress: &mut dyn FnMut(&str),
) -> ReviewOutcome {
    let EffectReview { evidence, baseline, .. } = *review;
    let reach = |model: &FittedModel| {
        crate::diagnose::report::conclusion::upper_bound_score(evidence, model)
    };
    if let Some(reviewed) = review.reject_if_unexplained(&model, &taken) {
        let null = NullReport {
            threshold_nats_per_event: MIN_GAIN_NATS_PER_EVENT,
            ..NullReport::default()
        };
        return ReviewOutcome { reach: reach(&model), reviewed, null };
    }
    progress("replaced effects");
    let coarse = baseline.clone().with_fine_grid(false);
    let (model, taken) = remove_replaced_effects(evidence, few, &coarse, model, taken);
    let found = (model.with_fine_grid(true), taken);
    let (model, taken, null) =
        remove_chance_effects(evidence, few, baseline, found, options, progress);
    progress("fine grid");
    let model = refine_on_fine_grid(evidence, model);
    let review = EffectReview { null: &null.residual_structure_nats_per_event, ..*review };
    progress("errors");
    // A model that will be rejected needs no standard errors.
    let (model, taken) = if review.is_inadequate(&model) {
        (model, taken)
    } else {
        remove_unidentified_effects(evidence, baseline, model, taken)
    };
    let reach = reach(&model);
    ReviewOutcome { reviewed: review.review(model, taken), reach, null }
}

/// Removes effects whose gain is at chance level, before the fine grid is used.
fn remove_chance_effects(
    evidence: &Evidence,
    few: &Evidence,
    baseline: &FittedModel,
    (model, taken): (FittedModel, Vec<AcceptedEffect>),
    options: &DiagnosisOptions,
    progress: &mut dyn FnMut(&str),
) -> (FittedModel, Vec<AcceptedEffect>, NullReport) {
    progress("null");
    let null_distribution::NullDraws { gains, structures } = null_distribution::null_draws(
        evidence,
        few,
        &model,
        options.n_null,
        options.seed,
        progress,
    );
    let worst = gains.iter().copied().fold(0.0, f64::max);
    let bar = MIN_GAIN_NATS_PER_EVENT
        .max(worst)
        .max(0.01 * crate::diagnose::report::conclusion::excess(evidence, baseline, &model));
    let (model, taken) = remove_effects_below(evidence, baseline, model, taken, bar);
    let null = NullReport {
        n: options.n_null,
        greatest_gains: gains,
        threshold_nats_per_event: bar,
        residual_structure_nats_per_event: structures,
    };
    (model, taken, null)
}

/// The fitted baseline. Interpolated light makes the likelihood multimodal in the clock offset:
/// several offsets are tried.
fn fit_baseline(evidence: &Evidence, few: &Evidence) -> FittedModel {
    let mut begun = fit(few, Hypothesis::baseline(evidence), 12, 1e-4);
    if evidence.facts.is_motion_compensated {
        let us = evidence.facts.offset_bound_us / f64::from(N_OFFSET_STARTS);
        let at = |i| begun.hypothesis.with_nuisance(Nuisance::OffsetUs, us * f64::from(i));
        let elsewhere = score_models(few, (-N_OFFSET_STARTS..=N_OFFSET_STARTS).map(at).collect());
        let best = elsewhere.into_iter().max_by(|a, b| a.training().total_cmp(&b.training()));
        let there = best.map(|best| improve(few, best, 12, 1e-4));
        begun = there.into_iter().fold(begun, FittedModel::better_of);
    }
    fit_and_refine(evidence, begun.hypothesis, 12)
}

/// Adds effects while their gain is significant. A fit with an effect may find better nuisances
/// than the fit without; the model adopts them first, so that the effect is not credited with
/// them.
fn accept_effects(
    evidence: &Evidence,
    few: &Evidence,
    mut baseline: FittedModel,
    max_effects: usize,
    progress: &mut dyn FnMut(&str),
) -> (FittedModel, FittedModel, Vec<AcceptedEffect>, Option<RejectedEffect>) {
    let mut model = baseline.clone();
    let (mut taken, mut unsure) = (Vec::new(), None);
    while taken.len() < max_effects {
        let mut tried: Vec<TrialFit> = scan_library(evidence, few, &model, progress)
            .into_iter()
            .filter(|tried| has_signature(evidence, tried, inner_tiles))
            .collect();
        for _ in 0..3 {
            let Some(best) = tried.first() else { break };
            let same = model.hypothesis.at_values_of(&best.fitted.hypothesis);
            let without = fit(evidence, same, 6, 1e-5);
            if without.training() <= model.training() + 1e-4 {
                break;
            }
            model = without;
            if taken.is_empty() {
                baseline = model.clone();
            }
            tried =
                tried.into_iter().map(|tried| tried.measured_against(evidence, &model)).collect();
            sort_by_gain(&mut tried);
        }
        converge_competitors(evidence, &model, &mut tried, progress);
        if tried.first().is_some_and(|best| !holds_on_fine_grid(evidence, &model, best)) {
            tried.remove(0);
            converge_competitors(evidence, &model, &mut tried, progress);
        }
        tried.retain(|tried| has_signature(evidence, tried, |_, region| region));
        let Some(best) = tried.first() else { break };
        let gain = best.gain;
        if !best.uses_all_pixels {
            break;
        }
        if !is_significant(gain.held_out, gain.error) {
            unsure = suggestive_effect(gain);
            break;
        }
        progress(&format!("{} is accepted", gain.id));
        taken.push(AcceptedEffect {
            gain: gain.held_out,
            error: gain.error,
            competing_hypotheses: competing_hypotheses(&tried),
            indistinguishable: indistinguishable(&tried),
        });
        model = best.fitted.clone();
    }
    (baseline, model, taken, unsure)
}

/// Whether a threshold mismatch remains significant (or suggestive) on the fine grid. The coarse
/// grid overestimates the likelihood of a nearly noise-free camera between its values.
pub(crate) fn holds_on_fine_grid(
    evidence: &Evidence,
    model: &FittedModel,
    tried: &TrialFit,
) -> bool {
    let coarse = &tried.fitted.hypothesis;
    let has_own =
        coarse.pixel_mixture().is_continuous() && !model.hypothesis.pixel_mixture().is_continuous();
    let (gain, error) = (tried.gain.held_out, tried.gain.error);
    let asked = if is_significant(gain, error) { is_significant } else { is_suggestive };
    if !has_own || !asked(gain, error) {
        return true;
    }
    let holds = |fine: &FittedModel| {
        let (gain, error) = effect_gain(evidence, fine, model.hypothesis.effects.len(), model);
        asked(gain, error)
    };
    let fine = score_model(evidence, Hypothesis { uses_fine_grid: true, ..coarse.clone() });
    holds(&fine) || holds(&improve(evidence, fine, MAX_STEPS_ON_FINE_GRID, 1e-4))
}

/// A large gain that is not significant.
fn suggestive_effect(gain: EffectGain) -> Option<RejectedEffect> {
    let errors = gain.held_out / gain.error;
    is_suggestive(gain.held_out, gain.error).then(|| RejectedEffect {
        id: gain.id,
        heldout_gain_nats_per_event: gain.held_out,
        because: format!(
            "its gain is {errors:.2} standard errors, below the {MIN_GAIN_STANDARD_ERRORS:.0} \
             required: use more pixels (--pixels) or a longer recording"
        ),
    })
}

/// Fits the best effects to convergence, since incomplete fits may be ranked wrongly: those close
/// to the best, known competitors of the best, and, where all gains are low, effects limited by a
/// prior bound.
fn converge_competitors(
    evidence: &Evidence,
    model: &FittedModel,
    tried: &mut Vec<TrialFit>,
    progress: &mut dyn FnMut(&str),
) {
    let Some(first) = tried.first() else { return };
    let best = first.gain.held_out;
    let known = first.fitted.hypothesis.effects.last().map_or(&[][..], |effect| effect.competing);
    let near = |tried: &TrialFit| {
        let is_rival = tried.gain.held_out > MIN_COMPETITOR_GAIN_SHARE * best
            || known.contains(&tried.gain.id);
        (tried.uses_all_pixels && best >= MIN_GAIN_NATS_PER_EVENT && is_rival)
            || (best < LOW_GAIN_NATS_PER_EVENT && tried.is_limited_by_prior(&model.hypothesis))
    };
    let (rivals, rest): (Vec<TrialFit>, Vec<TrialFit>) = tried.drain(..).partition(near);
    let n_finished = rivals.len().min(MAX_CONVERGED_COMPETITORS);
    tried.extend(rivals.into_iter().enumerate().map(|(i, rival)| {
        if i >= n_finished || rival.has_converged {
            return rival;
        }
        progress(&format!("{} to convergence", rival.gain.id));
        rival.converged(evidence, model)
    }));
    tried.extend(rest);
    sort_by_gain(tried);
}

/// Whether the events of the last effect's region (as changed by `inner`) show its signature.
fn has_signature(
    evidence: &Evidence,
    tried: &TrialFit,
    inner: impl Fn(&Evidence, Rectangle) -> Rectangle,
) -> bool {
    let hypothesis = &tried.fitted.hypothesis;
    let last = hypothesis.effects.len() - 1;
    let part =
        hypothesis.regions[last].map(|region| evidence.within_region(inner(evidence, region)));
    let there = part.as_ref().unwrap_or(evidence);
    (hypothesis.effects[last].has_signature)(there, &hypothesis.parameters_of(last))
}

/// A region of whole tiles without its outermost tiles, which may lie partly outside.
fn inner_tiles(evidence: &Evidence, region: Rectangle) -> Rectangle {
    let tile = evidence.tile_px;
    let inner = |[low, high]: [u16; 2]| {
        if high - low > 2 * tile { [low + tile, high - tile] } else { [low, high] }
    };
    Rectangle { x_px: inner(region.x_px), y_px: inner(region.y_px) }
}

fn competing_hypotheses(tried: &[TrialFit]) -> Vec<CompetingHypothesis> {
    let rest = tried.iter().skip(1).take(5);
    rest.map(|t| CompetingHypothesis {
        id: t.gain.id,
        heldout_gain_nats_per_event: t.gain.held_out,
    })
    .collect()
}

/// Effects whose gain is not significantly below the best.
fn indistinguishable(tried: &[TrialFit]) -> Vec<evrig_core::effect_id::EffectId> {
    let Some(best) = tried.first() else { return Vec::new() };
    let close = |t: &&TrialFit| {
        let (gain, error) = best.fitted.cells.gain(&t.fitted.cells, CellSet::HeldOut);
        !is_significant(gain, error)
    };
    // Fits on a subset of the pixels are not comparable.
    tried.iter().skip(1).filter(|t| t.uses_all_pixels).filter(close).map(|t| t.gain.id).collect()
}

/// The model refitted on the fine grid.
fn refine_on_fine_grid(evidence: &Evidence, model: FittedModel) -> FittedModel {
    if !model.hypothesis.pixel_mixture().is_continuous() {
        return model;
    }
    fit_and_refine(evidence, model.hypothesis, MAX_STEPS_ON_FINE_GRID)
}
