//! From a selection of effects to the reported diagnosis.

use super::constants::{CameraConstant, ReportedAs};
use super::findings::{Findings, interval};
use super::fit::ModelFit;
use super::goodness::{GoodnessOfFit, NEGLIGIBLE_NATS_PER_EVENT};
use super::law::logistic;
use super::select::{EffectSelection, held_out, select};
use crate::diagnose::checks::two_sample_test::StructureTest;
use crate::diagnose::fit::effect_scan::cannot_judge;
use crate::diagnose::report::conclusion::residual_structure;
use crate::diagnose::report::departure::{effect_of, upper_tail_probability};
use crate::diagnose::report::diagnosis_report::DIAGNOSIS_SCHEMA;
use crate::diagnose::sensor_wide::{SensorWideStatistics, sensor_wide_statistics};
use crate::diagnose::{
    BaselineMismatch, ConfidenceInterval, Departure, Diagnosis, DiagnosisOptions, DiagnosisVerdict,
    Evidence, FitReport, FittedEffect, HeldOutScores, NullReport, RejectedEffect, ResidualMismatch,
    ResidualStructureReport,
};
use std::collections::BTreeMap;

/// A mismatch below this is minor: 1 nat in twenty events.
const MINOR_NATS_PER_EVENT: f64 = 0.05;

/// Finds effects by the smooth likelihood; a second engine beside
/// [`diagnose`](crate::diagnose::diagnose).
#[must_use]
pub fn diagnose_smooth(
    evidence: &Evidence,
    departures: &[Departure],
    options: &DiagnosisOptions,
    progress: &mut dyn FnMut(&str),
) -> Diagnosis {
    let sensor = sensor_wide_statistics(evidence);
    let evidence = sensor.rest.as_ref().unwrap_or(evidence);
    let max_effects = if sensor.is_saturated { 0 } else { options.max_effects };
    let found = select(evidence, max_effects, progress);
    progress("errors");
    let findings = Findings::of(evidence, &found);
    progress("two-sample test");
    conclude(evidence, departures, &sensor, findings, &found, options.seed)
}

fn conclude(
    evidence: &Evidence,
    departures: &[Departure],
    sensor: &SensorWideStatistics,
    findings: Findings,
    found: &EffectSelection,
    seed: u64,
) -> Diagnosis {
    let Findings { effects: named, baseline, errors } = findings;
    let [before, after] = [&baseline, &found.fit].map(|f| GoodnessOfFit::of(evidence, f, seed));
    let low = held_out(evidence, &baseline.evaluation);
    let high = held_out(evidence, &found.fit.evaluation);
    let upper_bound =
        (low + before.recalibration.gain).max(high + after.recalibration.gain.max(0.0)).max(high);
    let excess = upper_bound - low;
    let share = (excess > NEGLIGIBLE_NATS_PER_EVENT).then(|| (high - low) / excess);
    let verdict = verdict(named.is_empty(), share, &after);
    let is_named =
        matches!(verdict, DiagnosisVerdict::Explained | DiagnosisVerdict::PartlyExplained);
    let (named, rejected) = if is_named { (named, Vec::new()) } else { (Vec::new(), named) };
    let (verdict, effects) = with_departures(verdict, departures, sensor, named);
    let p_value = |gain: f64, error: f64| {
        if error > 0.0 { upper_tail_probability(gain / error) } else { 1.0 }
    };
    Diagnosis {
        schema: DIAGNOSIS_SCHEMA.into(),
        verdict,
        mismatch: BaselineMismatch {
            excess_nats_per_event: excess,
            p_value: p_value(before.recalibration.gain, before.recalibration.error),
            strata: before.strata(),
        },
        effects,
        nuisances: constants(evidence, &found.fit, &errors, found.spread_ci),
        fit: FitReport {
            heldout_nats_per_event: HeldOutScores {
                baseline: low,
                r#final: high,
                upper_bound,
                upper_bound_source: "hazard_recalibration".into(),
            },
            share_of_excess_removed: share,
            forward_simulation: BTreeMap::new(),
        },
        residual_mismatch: ResidualMismatch {
            excess_nats_per_event: upper_bound - high,
            p_value: p_value(after.recalibration.gain, after.recalibration.error),
            strata: after.strata(),
        },
        proposed_term: after.structure.as_ref().and_then(StructureTest::hazard_term),
        next_recording: None,
        cannot_judge: cannot_judge(evidence, sensor.is_saturated),
        rejected_effects: rejected.into_iter().map(rejected_effect).collect(),
        split_half: Vec::new(),
        stamp_step_us: evidence.facts.stamp_step_us,
        structure: before.structure.as_ref().zip(after.structure.as_ref()).map(|(a, b)| {
            ResidualStructureReport {
                baseline: residual_structure(a),
                r#final: residual_structure(b),
            }
        }),
        null: NullReport {
            threshold_nats_per_event: NEGLIGIBLE_NATS_PER_EVENT,
            ..NullReport::default()
        },
        n_pixels: evidence.pixels.len(),
        n_events: evidence.n_events(),
    }
}

/// Adds the effects that frames and sensor-wide statistics show; fitted ones take precedence.
fn with_departures(
    verdict: DiagnosisVerdict,
    departures: &[Departure],
    sensor: &SensorWideStatistics,
    named: Vec<FittedEffect>,
) -> (DiagnosisVerdict, Vec<FittedEffect>) {
    let beside = departures.iter().chain(&sensor.departures);
    let mut effects: Vec<FittedEffect> =
        beside.map(|departure| effect_of(departure, (0.0, 0.0))).collect();
    effects.retain(|effect| named.iter().all(|other| other.id != effect.id));
    let verdict = match verdict {
        _ if effects.is_empty() => verdict,
        DiagnosisVerdict::NoMismatch | DiagnosisVerdict::MinorMismatch => {
            DiagnosisVerdict::Explained
        }
        DiagnosisVerdict::Unexplained => DiagnosisVerdict::PartlyExplained,
        other => other,
    };
    effects.extend(named);
    (verdict, effects)
}

fn rejected_effect(effect: FittedEffect) -> RejectedEffect {
    RejectedEffect {
        id: effect.id,
        heldout_gain_nats_per_event: effect.heldout_gain_nats_per_event,
        because: "events drawn from the model with it still differ from the recorded ones".into(),
    }
}

/// Decides by the tests that reject and by the share of the excess that is removed.
fn verdict(names_nothing: bool, share: Option<f64>, after: &GoodnessOfFit) -> DiagnosisVerdict {
    let left = after.misfit();
    match share {
        _ if names_nothing && left < NEGLIGIBLE_NATS_PER_EVENT => DiagnosisVerdict::NoMismatch,
        _ if names_nothing && left < MINOR_NATS_PER_EVENT => DiagnosisVerdict::MinorMismatch,
        _ if names_nothing => DiagnosisVerdict::Unexplained,
        Some(share) if share >= 0.5 && left < MINOR_NATS_PER_EVENT => DiagnosisVerdict::Explained,
        Some(share) if share >= 0.25 && left < 2.0 * MINOR_NATS_PER_EVENT => {
            DiagnosisVerdict::PartlyExplained
        }
        _ => DiagnosisVerdict::Unexplained,
    }
}

/// Fitted constants by key, in reported units.
fn constants(
    evidence: &Evidence,
    fit: &ModelFit,
    errors: &[f64],
    spread: [f64; 3],
) -> BTreeMap<String, ConfidenceInterval> {
    let is_fitted = |c: &CameraConstant| c.prior(&evidence.facts).sd > 0.0;
    let one = |c: CameraConstant| {
        let natural = |v: f64| match c.key().1 {
            ReportedAs::Value => v,
            ReportedAs::Exponential => v.exp(),
            ReportedAs::Logistic => logistic(v),
            ReportedAs::OnePlus => 1.0 + v,
        };
        let value = interval(fit.model.constant(c), errors[c as usize], natural);
        (c.key().0.to_owned(), value)
    };
    let mut all: BTreeMap<String, ConfidenceInterval> =
        CameraConstant::ALL.iter().copied().filter(is_fitted).map(one).collect();
    let [value, low, high] = spread;
    let spread = ConfidenceInterval { value, ci90: [Some(low), Some(high)] };
    all.insert("threshold_spread".into(), spread);
    all
}
