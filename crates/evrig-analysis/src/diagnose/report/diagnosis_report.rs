//! The result of a diagnosis, as it is written to `diagnosis.json`.
//!
//! Scores are log-likelihoods in nats per event on held-out cells (a tile of pixels during a block
//! of time). Keys of schema `evrig.diagnosis/1` are read as aliases.

use super::forward_simulation::ModelComparison;
use evrig_core::effect_id::EffectId;
use evrig_core::stats::Z90;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Schema of `diagnosis.json`.
pub(crate) const DIAGNOSIS_SCHEMA: &str = "evrig.diagnosis/3";

/// Conclusion of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DiagnosisVerdict {
    /// The baseline model is adequate.
    NoMismatch,
    /// A mismatch is significant and small; nothing is named.
    MinorMismatch,
    /// The named effects remove at least half of the excess.
    Explained,
    /// The named effects remove at least a quarter of the excess.
    PartlyExplained,
    /// The library's effects remove less than a quarter of the excess.
    Unexplained,
}

/// An estimate with its 90 % confidence interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ConfidenceInterval {
    /// The estimate.
    pub value: f64,
    /// Ends of the interval; `null` where unknown.
    pub ci90: [Option<f64>; 2],
}

impl ConfidenceInterval {
    /// Of a normal error; its ends are unknown where the error is.
    pub(crate) fn normal([value, error]: [f64; 2]) -> Self {
        let ci90 = [-Z90, Z90].map(|z| Some(value + z * error).filter(|end| end.is_finite()));
        Self { value, ci90 }
    }
}

/// A stratum of events in which the model misfits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MisfitStratum {
    /// The covariate that defines the stratum.
    pub covariate: String,
    /// Range of the covariate.
    pub range: [f64; 2],
    /// Log-likelihood gain of a recalibration within the stratum, nats per event of all events.
    pub excess_nats_per_event: f64,
    /// Mean change of the signal beyond the threshold, in thresholds: positive for late events.
    /// `null` where numbers of events are compared.
    pub innovation_thresholds: Option<f64>,
    /// Recorded over simulated events, where numbers of events are compared.
    #[serde(default)]
    pub ratio: Option<f64>,
    /// Number of events in the stratum.
    pub n_events: u64,
    /// The finding in a sentence.
    #[serde(alias = "says")]
    pub description: String,
}

/// Misfit of the baseline.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BaselineMismatch {
    /// Upper bound minus baseline.
    pub excess_nats_per_event: f64,
    /// Chance of such a gain without a mismatch, from the scatter over cells.
    pub p_value: f64,
    /// Strata with a misfit, largest excess first.
    #[serde(rename = "where")]
    pub strata: Vec<MisfitStratum>,
}

/// Another effect that was fitted in place of a named one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CompetingHypothesis {
    /// The effect.
    pub id: EffectId,
    /// Its gain in place of the named effect.
    pub heldout_gain_nats_per_event: f64,
}

/// A named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FittedEffect {
    /// The effect.
    pub id: EffectId,
    /// Its name.
    pub name: String,
    /// Its equation.
    pub equation: String,
    /// The finding in a sentence.
    #[serde(alias = "says")]
    pub description: String,
    /// Parameters by key.
    pub parameters: BTreeMap<String, ConfidenceInterval>,
    /// Gain over the model with the effects before it.
    pub heldout_gain_nats_per_event: f64,
    /// Standard error of the gain.
    pub heldout_gain_error: f64,
    /// Chance of such a gain without the effect, Bonferroni-corrected for the size of the library;
    /// of such bursts without the effect, where they follow the camera's frames.
    pub p_value: f64,
    /// Effects that are not significantly worse in its place, or that events alone cannot separate.
    #[serde(alias = "equivalent")]
    pub indistinguishable: Vec<EffectId>,
    /// Effects tried in its place, best first.
    #[serde(alias = "rivals")]
    pub competing_hypotheses: Vec<CompetingHypothesis>,
}

impl FittedEffect {
    /// Whether the likelihood does not depend on the effect: it was found in sensor-wide event
    /// statistics or in the frames.
    #[must_use]
    pub fn is_beside_the_score(&self) -> bool {
        self.heldout_gain_nats_per_event == 0.0 && self.heldout_gain_error == 0.0
    }
}

/// Held-out log-likelihoods, nats per event.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOutScores {
    /// Nuisances alone.
    pub baseline: f64,
    /// With the named effects.
    pub r#final: f64,
    /// Upper bound by hazard recalibration.
    #[serde(alias = "ceiling")]
    pub upper_bound: f64,
    /// How the upper bound was obtained.
    #[serde(alias = "ceiling_is")]
    pub upper_bound_source: String,
}

/// Improvement of the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Scores of baseline, final model and upper bound.
    pub heldout_nats_per_event: HeldOutScores,
    /// (final - baseline) / (upper bound - baseline); `null` without an excess.
    pub share_of_excess_removed: Option<f64>,
    /// Measures of the forward simulation against the recording; empty where there is none.
    #[serde(alias = "forward")]
    pub forward_simulation: BTreeMap<String, ModelComparison>,
}

/// Misfit of the final model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResidualMismatch {
    /// Upper bound minus final.
    pub excess_nats_per_event: f64,
    /// Chance of such a gain without a mismatch.
    pub p_value: f64,
    /// Strata with a misfit, largest excess first.
    #[serde(rename = "where")]
    pub strata: Vec<MisfitStratum>,
}

/// Result of the classifier two-sample test between recorded and simulated next events.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResidualStructure {
    /// Log-loss gain of boosted trees over chance, nats per event; at most ln 2.
    pub nats_per_event: f64,
    /// Its standard error.
    pub error: f64,
    /// Gain without the features that an error of the light changes (light and neighbours); only
    /// where the light between frames is interpolated.
    #[serde(default, skip_serializing_if = "Option::is_none", alias = "nats_apart_from_light")]
    pub nats_without_light_features: Option<f64>,
    /// Balanced accuracy; 0.5 without residual structure.
    pub accuracy: f64,
    /// Features by importance, largest first.
    #[serde(alias = "told_by")]
    pub top_features: Vec<String>,
}

/// An effect with a gain that failed a test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RejectedEffect {
    /// The effect.
    pub id: EffectId,
    /// Its gain on held-out cells.
    pub heldout_gain_nats_per_event: f64,
    /// Which test it failed.
    pub because: String,
}

/// Residual structure of both models.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResidualStructureReport {
    /// Nuisances alone.
    pub baseline: ResidualStructure,
    /// With all effects that were found, named or not.
    pub r#final: ResidualStructure,
}

/// A term outside the library that would reduce the residual mismatch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProposedTerm {
    /// Point of entry: `threshold`, `time_stamp` or `hazard`.
    pub enters: String,
    /// The covariate on which it depends.
    pub depends_on: String,
    /// Covariate, mean innovation in thresholds, low and high end of its 90 % band.
    pub curve: Vec<[f64; 4]>,
    /// Held-out gain of a hazard recalibrated by that covariate.
    pub heldout_gain_nats_per_event: f64,
}

/// An effect that this session cannot test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UntestableEffect {
    /// The effect.
    pub id: EffectId,
    /// Why.
    pub because: String,
}

/// `diagnosis.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// `evrig.diagnosis/3`.
    pub schema: String,
    /// The conclusion.
    pub verdict: DiagnosisVerdict,
    /// Misfit of the baseline.
    pub mismatch: BaselineMismatch,
    /// Named effects in the order in which they were accepted.
    pub effects: Vec<FittedEffect>,
    /// Nuisances of the final model by key.
    pub nuisances: BTreeMap<String, ConfidenceInterval>,
    /// Keys of nuisances that lie at an end of their ordinary range, which has no interval: something
    /// that the model lacks may pull them there.
    #[serde(default)]
    pub at_range_end: Vec<String>,
    /// Improvement of the model.
    pub fit: FitReport,
    /// Misfit of the final model.
    #[serde(alias = "leftover")]
    pub residual_mismatch: ResidualMismatch,
    /// A term that would help where no effect of the library does.
    pub proposed_term: Option<ProposedTerm>,
    /// A recording that would separate indistinguishable effects.
    pub next_recording: Option<String>,
    /// Effects that this session cannot test.
    pub cannot_judge: Vec<UntestableEffect>,
    /// Effects with a gain that failed a test.
    #[serde(default, alias = "suspects")]
    pub rejected_effects: Vec<RejectedEffect>,
    /// Step of the grid on which the recording's time stamps lie, microseconds; `null` without a
    /// grid. Events were spread uniformly over a step, which bounds the temporal resolution.
    #[serde(default)]
    pub stamp_step_us: Option<f64>,
    /// Classifier two-sample test of both models; `null` with too few events.
    #[serde(default)]
    pub structure: Option<ResidualStructureReport>,
    /// Number of pixels analysed.
    pub n_pixels: usize,
    /// Number of their events.
    pub n_events: usize,
}

impl Diagnosis {
    /// Share of the excess that the named effects remove; `None` where the likelihood depends on
    /// none of them.
    #[must_use]
    pub fn share_removed(&self) -> Option<f64> {
        let is_scored = !self.effects.iter().all(FittedEffect::is_beside_the_score);
        self.fit.share_of_excess_removed.filter(|_| is_scored)
    }

    /// Which nuisances lie at an end of their range, in a sentence; `None` where none does.
    #[must_use]
    pub fn range_ends(&self) -> Option<String> {
        let keys = self.at_range_end.join(", ");
        (!keys.is_empty())
            .then(|| format!("At the end of the range that an ordinary camera has: {keys}."))
    }

    /// What a grid of time stamps implies, in a sentence; `None` without a grid.
    #[must_use]
    pub fn coarse_stamps(&self) -> Option<String> {
        let step_us = self.stamp_step_us?;
        Some(format!(
            "The time stamps lie on a grid of {step_us:.1} us, as from a simulator with that time \
             step. Events were spread uniformly over a step, which bounds the temporal resolution."
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagnosis_of_schema_1_is_read() {
        let place = r#"{"covariate": "row", "range": [0, 9], "excess_nats_per_event": 0.1,
            "innovation_thresholds": null, "n_events": 70, "says": "in rows 0 to 9"}"#;
        let left = r#"{"nats_per_event": 0.1, "error": 0.01, "nats_apart_from_light": 0.05,
            "accuracy": 0.6, "told_by": ["row"]}"#;
        let old = format!(
            r#"{{"schema": "evrig.diagnosis/1", "verdict": "explained",
            "mismatch": {{"excess_nats_per_event": 0.2, "p_value": 0.0, "where": [{place}]}},
            "effects": [{{"id": "flicker", "name": "Flicker", "equation": "", "says": "at 100 Hz",
                "parameters": {{}}, "heldout_gain_nats_per_event": 0.1, "heldout_gain_error": 0.01,
                "p_value": 0.0, "region": null, "equivalent": ["vibration"],
                "rivals": [{{"id": "vibration", "heldout_gain_nats_per_event": 0.05}}]}}],
            "nuisances": {{}},
            "fit": {{"heldout_nats_per_event": {{"baseline": 0.0, "final": 0.1, "ceiling": 0.2,
                "ceiling_is": "flexible_fit"}}, "share_of_excess_removed": 0.5,
                "forward": {{"count_ratio": {{"baseline": 2.0, "final": 1.0}}}}}},
            "leftover": {{"excess_nats_per_event": 0.1, "p_value": 0.1, "where": []}},
            "proposed_term": null, "next_recording": null, "cannot_judge": [],
            "suspects": [{{"id": "defocus", "heldout_gain_nats_per_event": 0.1, "because": "x"}}],
            "halves": [{{"of": "even tiles", "n_events": 7, "heldout_gain_nats_per_event": 0.1,
                "heldout_gain_error": 0.1, "parameters": {{}}}}],
            "structure": {{"baseline": {left}, "final": {left}}},
            "null": {{"n": 1, "greatest_gains": [0.0], "bar_nats_per_event": 0.02,
                "structures_nats_per_event": [0.01]}}, "n_pixels": 3, "n_events": 70}}"#
        );
        let read: Diagnosis = serde_json::from_str(&old).unwrap();
        assert_eq!(read.mismatch.strata[0].description, "in rows 0 to 9");
        assert_eq!(read.effects[0].indistinguishable, [EffectId::Vibration]);
        assert_eq!(read.effects[0].competing_hypotheses[0].id, EffectId::Vibration);
        assert_eq!(read.fit.heldout_nats_per_event.upper_bound, 0.2);
        assert_eq!(read.fit.forward_simulation["count_ratio"].baseline, Some(2.0));
        assert_eq!(read.rejected_effects[0].because, "x");
        let structure = read.structure.unwrap();
        assert_eq!(structure.baseline.top_features, ["row"]);
        assert_eq!(structure.r#final.nats_without_light_features, Some(0.05));
    }
}
