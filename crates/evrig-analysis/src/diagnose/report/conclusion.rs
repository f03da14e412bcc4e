//! From the fitted models to the reported diagnosis.

use super::departure::upper_tail_probability;
use super::diagnosis_report::DIAGNOSIS_SCHEMA;
use super::parameter_intervals::{nuisances, parameters};
use super::proposed_term::propose_term;
use crate::diagnose::checks::acceptance::Adequacy;
use crate::diagnose::checks::accepted_effect::AcceptedEffect;
use crate::diagnose::checks::event_strata::misfit_strata;
use crate::diagnose::checks::two_sample_test::StructureTest;
use crate::diagnose::checks::upper_bound::recalibration_gain;
use crate::diagnose::fit::cell_scores::CellSet;
use crate::diagnose::fit::effect_scan::cannot_judge;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::sensor_wide::IsolatedEventDeficit;
use crate::diagnose::{
    BaselineMismatch, Diagnosis, DiagnosisVerdict, Evidence, FitReport, FittedEffect,
    HeldOutScores, LIBRARY, NullReport, ProposedTerm, RejectedEffect, ResidualMismatch,
    ResidualStructureReport, SplitHalfFit,
};
use std::collections::BTreeMap;

/// A smaller excess is no mismatch.
const MIN_EXCESS_NATS_PER_EVENT: f64 = 0.06;

/// Results of the search.
pub(crate) struct SearchOutcome {
    pub(crate) taken: Vec<AcceptedEffect>,
    pub(crate) adequacy: Adequacy,
    /// Residual structure of the baseline and of the model with all found effects.
    pub(crate) before: Option<StructureTest>,
    pub(crate) after: Option<StructureTest>,
    /// Upper bound from the model with all found effects, nats per event.
    pub(crate) reach: f64,
    pub(crate) rejected_effects: Vec<RejectedEffect>,
    pub(crate) split_half: Vec<SplitHalfFit>,
    pub(crate) null: NullReport,
    /// Whether the readout is saturated, so that effects on single pixels were not searched.
    pub(crate) is_saturated: bool,
    /// A deficit of isolated events.
    pub(crate) isolated_events: Option<IsolatedEventDeficit>,
    /// Departures of the frames from the statement, and the fit to the signal as stated.
    pub(crate) departed: (Vec<FittedEffect>, Option<FittedModel>),
}

/// One-sided p-value of a gain; 1 without a measurement.
fn gain_p_value(gain: f64, error: f64) -> f64 {
    let z = gain / error;
    if z.is_nan() { 1.0 } else { upper_tail_probability(z) }
}

/// Held-out score of a model with recalibrated hazard, nats per event.
pub(crate) fn upper_bound_score(evidence: &Evidence, model: &FittedModel) -> f64 {
    model.held_out() + recalibration_gain(evidence, model).gain.max(0.0)
}

/// Upper bound minus baseline, nats per event.
pub(crate) fn excess(evidence: &Evidence, baseline: &FittedModel, model: &FittedModel) -> f64 {
    upper_bound_score(evidence, model).max(upper_bound_score(evidence, baseline))
        - baseline.held_out()
}

pub(crate) fn conclude(
    evidence: &Evidence,
    baseline: &FittedModel,
    model: &FittedModel,
    reached: SearchOutcome,
) -> Diagnosis {
    let SearchOutcome { taken, adequacy, rejected_effects, split_half, null, reach, .. } = reached;
    let (departures, as_stated) = reached.departed;
    let (left_before, left_after) = (reached.before, reached.after);
    let (missing, term) =
        reached.isolated_events.map(|IsolatedEventDeficit { place, term }| (place, term)).unzip();
    // Covariates that decide the verdict come first.
    let found = |model: &FittedModel, left: Option<&StructureTest>, least: f64| {
        let own = missing.iter().cloned().chain(misfit_strata(evidence, model, least)).collect();
        with_structure(own, left, least)
    };
    let [before, after] = [baseline, model].map(|model| recalibration_gain(evidence, model));
    let (low, high) = (baseline.held_out(), model.held_out());
    let upper_bound = (low + before.gain).max(high + after.gain.max(0.0)).max(reach);
    let (excess, share) = removed([low, high, upper_bound]);
    let verdict = verdict(taken.is_empty(), excess, share, adequacy).combined_with(
        !rejected_effects.is_empty(),
        missing.is_some(),
        !departures.is_empty(),
    );
    // Relative to the signal as stated, departures of the frames are part of what is explained.
    let low = as_stated.as_ref().map_or(low, FittedModel::held_out);
    let (excess, share) = removed([low, high, upper_bound]);
    let (gain, error) = match taken.as_slice() {
        [] => (before.gain, before.error),
        _ => model.cells.gain(&baseline.cells, CellSet::HeldOut),
    };
    let named = if verdict.names_effects() { effects(evidence, model, &taken) } else { Vec::new() };
    let effects = merge_effects(departures, named);
    let least = (0.02 * excess).max(0.002);
    Diagnosis {
        schema: DIAGNOSIS_SCHEMA.into(),
        verdict,
        mismatch: BaselineMismatch {
            excess_nats_per_event: excess,
            p_value: gain_p_value(gain, error),
            strata: found(baseline, left_before.as_ref(), least),
        },
        next_recording: next_recording(&effects),
        effects,
        nuisances: nuisances(model),
        at_range_end: Vec::new(),
        fit: scores([low, high, upper_bound], share),
        residual_mismatch: ResidualMismatch {
            excess_nats_per_event: upper_bound - high,
            p_value: gain_p_value(after.gain, after.error),
            strata: found(
                model,
                if taken.is_empty() { left_before.as_ref() } else { left_after.as_ref() },
                least,
            ),
        },
        proposed_term: term.or_else(|| propose_for(evidence, model, verdict, left_before.as_ref())),
        cannot_judge: cannot_judge(evidence, reached.is_saturated),
        rejected_effects,
        split_half,
        stamp_step_us: evidence.facts.stamp_step_us,
        structure: left_before.zip(left_after).map(of_both),
        null,
        n_pixels: evidence.pixels.len(),
        n_events: evidence.n_events(),
    }
}

/// The excess, and the share of it that is removed.
fn removed([low, high, upper_bound]: [f64; 3]) -> (f64, Option<f64>) {
    let excess = upper_bound - low;
    (excess, (excess > 0.0).then(|| (high - low) / excess))
}

/// Effects from frames and sensor-wide statistics, then fitted ones, which take precedence.
fn merge_effects(mut others: Vec<FittedEffect>, named: Vec<FittedEffect>) -> Vec<FittedEffect> {
    others.retain(|other| named.iter().all(|own| own.id != other.id));
    others.extend(named);
    others
}

/// The recording that separates the first effect from those indistinguishable from it.
fn next_recording(effects: &[FittedEffect]) -> Option<String> {
    let unsure = effects.iter().find(|effect| !effect.indistinguishable.is_empty())?;
    LIBRARY.iter().find(|c| c.id == unsure.id).map(|c| c.separating_recording.to_owned())
}

impl DiagnosisVerdict {
    /// Whether effects are reported as named.
    pub(crate) fn names_effects(self) -> bool {
        matches!(self, Self::Explained | Self::PartlyExplained)
    }

    /// Combines the verdict with rejected effects, missing isolated events, and departures of the
    /// frames or the sensor-wide statistics.
    pub(crate) fn combined_with(
        self,
        is_suspected: bool,
        are_missing: bool,
        testable_from_frames: bool,
    ) -> Self {
        let own = match self {
            Self::NoMismatch | Self::MinorMismatch if is_suspected || are_missing => {
                Self::Unexplained
            }
            Self::Explained if are_missing => Self::PartlyExplained,
            verdict => verdict,
        };
        match own {
            Self::NoMismatch | Self::MinorMismatch if testable_from_frames => Self::Explained,
            Self::Unexplained if testable_from_frames => Self::PartlyExplained,
            verdict => verdict,
        }
    }
}

pub(crate) fn scores([baseline, r#final, upper_bound]: [f64; 3], share: Option<f64>) -> FitReport {
    let upper_bound_source = "hazard_recalibration".into();
    FitReport {
        heldout_nats_per_event: HeldOutScores {
            baseline,
            r#final,
            upper_bound,
            upper_bound_source,
        },
        share_of_excess_removed: share,
        forward_simulation: BTreeMap::new(),
    }
}

fn verdict(
    names_nothing: bool,
    excess: f64,
    share: Option<f64>,
    adequacy: Adequacy,
) -> DiagnosisVerdict {
    match (names_nothing, share, adequacy) {
        (true, _, Adequacy::Adequate) if excess < MIN_EXCESS_NATS_PER_EVENT => {
            DiagnosisVerdict::NoMismatch
        }
        (true, ..) => DiagnosisVerdict::Unexplained,
        (false, Some(share), Adequacy::Adequate) if share >= 0.5 => DiagnosisVerdict::Explained,
        (false, Some(share), _) if share >= 0.25 => DiagnosisVerdict::PartlyExplained,
        (false, ..) => DiagnosisVerdict::Unexplained,
    }
}

/// Adds ranges of the two-sample test to strata of the recalibration.
pub(crate) fn with_structure(
    mut places: Vec<crate::diagnose::MisfitStratum>,
    left: Option<&StructureTest>,
    least: f64,
) -> Vec<crate::diagnose::MisfitStratum> {
    let around = left.into_iter().flat_map(|left| left.misfit_ranges.iter().cloned());
    places.extend(around.filter(|place| place.excess_nats_per_event > least));
    places
}

fn of_both((before, after): (StructureTest, StructureTest)) -> ResidualStructureReport {
    ResidualStructureReport {
        baseline: residual_structure(&before),
        r#final: residual_structure(&after),
    }
}

pub(crate) fn residual_structure(structure: &StructureTest) -> crate::diagnose::ResidualStructure {
    crate::diagnose::ResidualStructure {
        nats_per_event: structure.nats,
        error: structure.error,
        nats_without_light_features: structure.without_light_features,
        accuracy: structure.accuracy,
        top_features: structure.by.iter().take(4).map(|(key, _)| (*key).to_owned()).collect(),
    }
}

/// A term for the residual mismatch.
fn propose_for(
    evidence: &Evidence,
    model: &FittedModel,
    verdict: DiagnosisVerdict,
    left: Option<&StructureTest>,
) -> Option<ProposedTerm> {
    let is_wanted =
        matches!(verdict, DiagnosisVerdict::Unexplained | DiagnosisVerdict::PartlyExplained);
    let of_own = is_wanted.then(|| propose_term(evidence, model)).flatten();
    let of_others = || left.and_then(|left| left.hazard_term());
    match of_own {
        Some(own) => match of_others() {
            Some(other) if other.heldout_gain_nats_per_event > own.heldout_gain_nats_per_event => {
                Some(other)
            }
            _ => Some(own),
        },
        None => is_wanted.then(of_others).flatten(),
    }
}

fn effects(
    evidence: &Evidence,
    model: &FittedModel,
    taken: &[AcceptedEffect],
) -> Vec<FittedEffect> {
    let hypothesis = &model.hypothesis;
    taken
        .iter()
        .enumerate()
        .map(|(index, taken)| {
            let candidate = hypothesis.effects[index];
            let mut indistinguishable = taken.indistinguishable.clone();
            let same_law =
                candidate.same_law.iter().filter(|twin| !taken.indistinguishable.contains(twin));
            indistinguishable.extend(same_law);
            if evidence.facts.clock_tie.is_none() {
                indistinguishable.extend(candidate.inseparable);
            }
            let p_value = (gain_p_value(taken.gain, taken.error) * LIBRARY.len() as f64).min(1.0);
            FittedEffect {
                id: candidate.id,
                name: candidate.id.name().into(),
                equation: candidate.equation.into(),
                description: (candidate.describe)(&hypothesis.parameters_of(index)),
                parameters: parameters(evidence, model, index),
                heldout_gain_nats_per_event: taken.gain,
                heldout_gain_error: taken.error,
                p_value,
                region: hypothesis.regions[index].and_then(|r| serde_json::to_value(r).ok()),
                indistinguishable,
                competing_hypotheses: taken.competing_hypotheses.clone(),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn p_values_of_degenerate_gains() {
        assert_eq!([gain_p_value(0.0, 0.0), gain_p_value(1.0, 0.0)], [1.0, 0.0]);
        assert!((gain_p_value(1.644_853_6, 1.0) - 0.05).abs() < 1e-6);
    }
}
