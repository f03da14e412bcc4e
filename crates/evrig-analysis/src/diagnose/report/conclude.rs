//! From a selection of effects to the reported diagnosis.

use crate::diagnose::effect::{is_established_without_light, library_effect};
use crate::diagnose::fit::intervals::standard_errors;
use crate::diagnose::fit::optimizer::ModelFit;
use crate::diagnose::fit::paired_gain::PairedGain;
use crate::diagnose::fit::selection::{EffectSelection, held_out, select};
use crate::diagnose::levels::NEGLIGIBLE_NATS_PER_EVENT;
use crate::diagnose::model::constants::{CameraConstant, ReportedAs};
use crate::diagnose::report::departure::{effect_of, gains, upper_tail_probability};
use crate::diagnose::report::diagnosis_report::DIAGNOSIS_SCHEMA;
use crate::diagnose::report::findings::{Findings, interval};
use crate::diagnose::report::heat_map::heat_maps;
use crate::diagnose::report::model_camera::fitted_camera;
use crate::diagnose::report::untestable::cannot_judge;
use crate::diagnose::report::verdict::{residual_structure, scores};
use crate::diagnose::statistics::{SensorWideStatistics, sensor_wide_statistics};
use crate::diagnose::test::goodness::GoodnessOfFit;
use crate::diagnose::test::two_sample_test::StructureTest;
use crate::diagnose::test::upper_bound::RecalibrationGain;
use crate::diagnose::{
    BaselineMismatch, ConfidenceInterval, Departure, Diagnosis, DiagnosisOptions, DiagnosisVerdict,
    Evidence, FittedCamera, FittedEffect, HeatMap, RejectedEffect, ResidualMismatch,
    ResidualStructureReport,
};
use crate::predict::law::logistic;
use evrig_core::effect_id::EffectId;
use std::collections::BTreeMap;

/// A mismatch below this is minor: 1 nat in twenty events.
const MINOR_NATS_PER_EVENT: f64 = 0.05;

/// A diagnosis, its maps, and the cameras without and with the named effects; no camera where the
/// generator cannot represent one.
#[derive(Debug, Clone)]
pub struct DiagnosisResult {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// Maps of the misfit.
    pub heat: Vec<HeatMap>,
    /// The calibrated camera.
    pub baseline: Option<FittedCamera>,
    /// The camera with the named effects.
    pub camera: Option<FittedCamera>,
}

/// Which effects of the library does the recording show beyond an ordinary camera?
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
    let sensor = sensor_wide_statistics(evidence);
    let evidence = sensor.evidence.as_ref();
    let max_effects = if sensor.is_saturated { 0 } else { options.max_effects };
    let found = select(evidence, max_effects, options.seed, progress);
    progress("errors");
    let findings = Findings::of(evidence, &found);
    progress("two-sample test");
    // Without an effect both models are one.
    let before = if findings.effects.is_empty() {
        found.goodness.clone()
    } else {
        GoodnessOfFit::of(evidence, &findings.baseline, options.seed)
    };
    // Departures of the frames are part of what is explained, against the signal as stated.
    let (stated, gains) = gains(evidence, departures, &findings.baseline);
    let low = held_out(evidence, &stated.as_ref().unwrap_or(&findings.baseline).evaluation);
    let departures: Vec<_> = departures.iter().zip(gains).collect();
    let all = ModelScores::of(evidence, low, &before, &found);
    let verdict = verdict(findings.effects.is_empty(), all.share_removed(), &found.goodness);
    let is_established = |effect: &FittedEffect| is_established_without_light(effect.id);
    if verdict.names_effects() || findings.effects.iter().all(is_established) {
        return conclude(evidence, &sensor, departures, findings, &found, (all, verdict, before));
    }
    // What is not named is not in the final model either.
    let Findings { effects, baseline, .. } = findings;
    let found = EffectSelection {
        fit: baseline.clone(),
        steps: Vec::new(),
        goodness: before.clone(),
        ..found
    };
    let errors = standard_errors(evidence, &baseline);
    let bare = ModelScores::of(evidence, low, &before, &found);
    let findings = Findings { effects: Vec::new(), baseline, errors };
    let mut result =
        conclude(evidence, &sensor, departures, findings, &found, (bare, verdict, before));
    let is_unnamed =
        |effect: &FittedEffect| result.diagnosis.effects.iter().all(|named| named.id != effect.id);
    result.diagnosis.rejected_effects =
        effects.into_iter().filter(is_unnamed).map(rejected_effect).collect();
    result
}

/// Held-out log-likelihoods, nats per event.
struct ModelScores {
    /// Of the baseline with the signal as stated, and of the final model.
    low: f64,
    high: f64,
    upper_bound: f64,
    /// What the final model leaves.
    left: f64,
}

impl ModelScores {
    fn of(evidence: &Evidence, low: f64, before: &GoodnessOfFit, found: &EffectSelection) -> Self {
        let high = held_out(evidence, &found.fit.evaluation);
        let after = &found.goodness;
        let upper_bound = (low + before.recalibration.gain)
            .max(high + after.recalibration.gain.max(0.0))
            .max(high);
        Self { low, high, upper_bound, left: after.misfit() }
    }

    fn share_removed(&self) -> Option<f64> {
        let removed = (self.high - self.low).max(0.0);
        let all = removed + self.left;
        (all > NEGLIGIBLE_NATS_PER_EVENT).then(|| removed / all)
    }
}

fn conclude(
    evidence: &Evidence,
    sensor: &SensorWideStatistics<'_>,
    departures: Vec<(&Departure, PairedGain)>,
    findings: Findings,
    found: &EffectSelection,
    (scored, verdict, mut before): (ModelScores, DiagnosisVerdict, GoodnessOfFit),
) -> DiagnosisResult {
    let Findings { effects: named, baseline, errors } = findings;
    let mut after = found.goodness.clone();
    let share = scored.share_removed();
    let ModelScores { low, high, upper_bound, .. } = scored;
    let of_events = sensor.departures.iter().map(|departure| (departure, PairedGain::default()));
    let is_departed = !departures.is_empty() || !sensor.departures.is_empty();
    let effects = with_departures(departures.into_iter().chain(of_events), named);
    let deficit = sensor.isolated_events.as_ref();
    let held = found.fit.model.at_range_end(evidence);
    let is_pulled = !held.is_empty() && !found.steps.is_empty();
    let verdict = combined(verdict, [deficit.is_some(), is_departed, is_pulled]);
    let strata = |fit: &GoodnessOfFit| {
        deficit.iter().map(|deficit| deficit.place.clone()).chain(fit.strata()).collect()
    };
    let maps = [&mut before, &mut after].map(|fit| std::mem::take(&mut fit.by_pixel));
    let heat = heat_maps(evidence, &maps);
    let [bare, camera] = cameras(evidence, [&baseline, &found.fit], &effects, found);
    let diagnosis = Diagnosis {
        schema: DIAGNOSIS_SCHEMA.into(),
        verdict,
        mismatch: BaselineMismatch {
            excess_nats_per_event: upper_bound - low,
            p_value: p_value(&before),
            strata: strata(&before),
        },
        next_recording: next_recording(&effects),
        effects,
        nuisances: constants(evidence, &found.fit, &errors, found.spread_ci),
        at_range_end: held.iter().map(|c| c.key().0.into()).collect(),
        fit: scores([low, high, upper_bound], share),
        residual_mismatch: ResidualMismatch {
            excess_nats_per_event: upper_bound - high,
            p_value: p_value(&after),
            strata: strata(&after),
        },
        proposed_term: deficit
            .map(|deficit| deficit.term.clone())
            .or_else(|| after.structure.as_ref().and_then(StructureTest::hazard_term)),
        cannot_judge: cannot_judge(evidence, sensor.is_saturated),
        rejected_effects: Vec::new(),
        stamp_step_us: evidence.facts.stamp_step_us,
        structure: structure_report(&before, &after),
        n_pixels: evidence.pixels.len(),
        n_events: evidence.n_events(),
    };
    DiagnosisResult { diagnosis, heat, baseline: bare, camera }
}

/// Chance of the recalibration's gain under an adequate model.
fn p_value(fit: &GoodnessOfFit) -> f64 {
    let RecalibrationGain { gain, error } = fit.recalibration;
    if error > 0.0 { upper_tail_probability(gain / error) } else { 1.0 }
}

/// The verdict with a deficit of isolated events, departures of the frames, and constants that
/// something else pulls to the ends of their ranges.
fn combined(
    own: DiagnosisVerdict,
    [is_deficient, is_departed, is_pulled]: [bool; 3],
) -> DiagnosisVerdict {
    match own.combined_with(is_deficient, is_departed) {
        DiagnosisVerdict::Explained if is_pulled => DiagnosisVerdict::PartlyExplained,
        verdict => verdict,
    }
}

/// The cameras without and with the named effects.
fn cameras(
    evidence: &Evidence,
    fits: [&ModelFit; 2],
    effects: &[FittedEffect],
    found: &EffectSelection,
) -> [Option<FittedCamera>; 2] {
    let fitted: Vec<EffectId> = found.steps.iter().map(|step| step.id).collect();
    let of = |fit: &ModelFit, named| fitted_camera(evidence, &fit.model, named, &fitted);
    [of(fits[0], &[]), of(fits[1], effects)]
}

fn structure_report(
    before: &GoodnessOfFit,
    after: &GoodnessOfFit,
) -> Option<ResidualStructureReport> {
    let (baseline, last) = (before.structure.as_ref()?, after.structure.as_ref()?);
    Some(ResidualStructureReport {
        baseline: residual_structure(baseline),
        r#final: residual_structure(last),
    })
}

/// Adds the effects that frames and sensor-wide statistics show; fitted ones take precedence.
fn with_departures<'a>(
    departures: impl Iterator<Item = (&'a Departure, PairedGain)>,
    named: Vec<FittedEffect>,
) -> Vec<FittedEffect> {
    let mut effects: Vec<FittedEffect> =
        departures.map(|(departure, gain)| effect_of(departure, gain)).collect();
    for fitted in named {
        match effects.iter_mut().find(|effect| effect.id == fitted.id) {
            Some(shown) if fitted.description.is_empty() => {
                let description = std::mem::take(&mut shown.description);
                *shown = FittedEffect { description, ..fitted };
            }
            Some(shown) => *shown = fitted,
            None => effects.push(fitted),
        }
    }
    effects
}

/// The recording that separates the first effect from those indistinguishable from it.
fn next_recording(effects: &[FittedEffect]) -> Option<String> {
    let unsure = effects.iter().find(|effect| !effect.indistinguishable.is_empty())?;
    library_effect(unsure.id).map(|effect| effect.separating_recording.to_owned())
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
        _ if names_nothing && left <= 0.0 => DiagnosisVerdict::NoMismatch,
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
    let held = fit.model.at_range_end(evidence);
    let one = |c: CameraConstant| {
        let natural = |v: f64| match c.key().1 {
            ReportedAs::Value => v,
            ReportedAs::Exponential => v.exp(),
            ReportedAs::Logistic => logistic(v),
            ReportedAs::OnePlus => 1.0 + v,
        };
        let error = if held.contains(&c) { f64::INFINITY } else { errors[c as usize] };
        let value = interval(fit.model.constant(c), error, natural);
        (c.key().0.to_owned(), value)
    };
    let mut all: BTreeMap<String, ConfidenceInterval> =
        CameraConstant::ALL.iter().copied().filter(is_fitted).map(one).collect();
    let [value, low, high] = spread;
    let spread = ConfidenceInterval { value, ci90: [Some(low), Some(high)] };
    all.insert("threshold_spread".into(), spread);
    all
}
