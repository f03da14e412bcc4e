//! Comparison of an answer with the truth.

use super::answer::{AnsweredEffect, DiagnosisAnswer};
use super::record::TrialRecord;
use super::region::{f1, pointed_at};
use super::truth::SealedTruth;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// One parameter of a rightly named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterCheck {
    /// Its effect and key.
    pub id: String,
    /// Its key.
    pub key: String,
    /// Concealed value.
    pub truth: f64,
    /// Estimated value.
    pub value: f64,
    /// `|value - truth| / |truth|`.
    pub relative_error: f64,
    /// Whether the stated 90 % interval holds the truth; none when none was stated.
    pub is_covered: Option<bool>,
    /// The error in lengths of that side of the interval on which the truth lies: up to 1 inside.
    pub error_in_intervals: Option<f64>,
}

/// Judgement of an answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// The trial's name.
    pub trial: String,
    /// Ids of the concealed effects.
    pub hidden: Vec<String>,
    /// Their strengths, in the same order.
    pub strengths: Vec<f64>,
    /// Ids named.
    pub named: Vec<String>,
    /// The verdict.
    pub verdict: String,
    /// Whether the first name is one of those hidden.
    pub is_top1: bool,
    /// The same, with the equivalents that the answer itself states counted as named.
    pub is_top1_or_equivalent: bool,
    /// Names that are hidden, names that are not, and hidden ones not named (an equivalent counts).
    pub right: usize,
    /// Names that are not hidden.
    pub wrong: usize,
    /// Hidden ones that were not named.
    pub missed: usize,
    /// Parameters of the rightly named.
    pub parameters: Vec<ParameterCheck>,
    /// Overlap of the pixels pointed at with the region hidden, F1; none without a hidden region.
    pub region_f1: Option<f64>,
    /// Share of the excess removed, as answered.
    pub share_removed: Option<f64>,
    /// Nats per event the first name gains.
    pub first_gain: Option<f64>,
    /// Whether a concealed effect is outside the library.
    pub is_outside_library: bool,
    /// Whether the answer states that a concealed effect cannot be judged from this session.
    pub is_declared_undecidable: bool,
    /// Seconds the diagnosis took.
    pub diagnosed_s: f64,
}

/// Judges an answer. `known` are effects that the session is known to hold beside the hidden ones
/// (a real recording's own); naming them is neither right nor wrong.
#[must_use]
pub fn judge(
    record: &TrialRecord,
    answer: &DiagnosisAnswer,
    known: &BTreeSet<String>,
) -> Judgement {
    let truth = &record.truth;
    let counted: Vec<&AnsweredEffect> = answer
        .effects
        .iter()
        .filter(|named| is_hidden(truth, &named.id) || !known.contains(&named.id))
        .collect();
    let names = |named: &AnsweredEffect, id: &str| {
        named.id == id || named.indistinguishable.iter().any(|e| e == id)
    };
    let hits = |named: &&&AnsweredEffect| truth.effects.iter().any(|c| names(named, &c.id));
    let right = counted.iter().filter(hits).count();
    let missed =
        truth.effects.iter().filter(|c| !counted.iter().any(|named| names(named, &c.id))).count();
    let first = counted.first();
    Judgement {
        trial: record.trial.clone(),
        hidden: truth.effects.iter().map(|c| c.id.clone()).collect(),
        strengths: truth.effects.iter().map(|c| c.strength).collect(),
        named: counted.iter().map(|named| named.id.clone()).collect(),
        verdict: answer.verdict.clone(),
        is_top1: first.is_some_and(|named| is_hidden(truth, &named.id)),
        is_top1_or_equivalent: first.as_ref().is_some_and(hits),
        right,
        wrong: counted.len() - right,
        missed,
        parameters: counted.iter().flat_map(|named| checks(truth, named)).collect(),
        region_f1: truth.region.map(|region| f1(&region, &pointed_at(answer, record.sensor_px))),
        share_removed: answer.fit.share_of_excess_removed,
        first_gain: first.and_then(|named| named.heldout_gain_nats_per_event),
        is_outside_library: truth.is_outside_library(),
        is_declared_undecidable: answer.cannot_judge.iter().any(|not| is_hidden(truth, &not.id)),
        diagnosed_s: record.diagnosed_s,
    }
}

fn is_hidden(truth: &SealedTruth, id: &str) -> bool {
    truth.effects.iter().any(|concealed| concealed.id == id)
}

fn checks(truth: &SealedTruth, named: &AnsweredEffect) -> Vec<ParameterCheck> {
    let Some(concealed) = truth.effects.iter().find(|c| c.id == named.id) else {
        return Vec::new();
    };
    let check = |(key, &truth): (&String, &f64)| {
        let parameter = named.parameters.get(key)?;
        let value = parameter.value?;
        // What is hidden as zero has no relative error; it is a setting, not a strength.
        let relative_error = (truth != 0.0).then(|| ((value - truth) / truth).abs())?;
        let interval = match parameter.ci90 {
            Some([Some(low), Some(high)]) => Some([low, high]),
            _ => None,
        };
        let is_covered = interval.map(|[low, high]| (low..=high).contains(&truth));
        let error_in_intervals = interval.map(|[low, high]| {
            let side = if truth < value { value - low } else { high - value };
            if truth == value { 0.0 } else { (truth - value).abs() / side.max(f64::MIN_POSITIVE) }
        });
        let (id, key) = (named.id.clone(), key.clone());
        Some(ParameterCheck {
            id,
            key,
            truth,
            value,
            relative_error,
            is_covered,
            error_in_intervals,
        })
    };
    concealed.parameters.iter().filter_map(check).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{ConcealedEffect, DiagnosisOutcome};
    use super::*;
    use evrig_core::geometry::Rectangle;

    fn truth(ids: &[(&str, &str, f64)]) -> SealedTruth {
        let effects = ids.iter().map(|&(id, key, value)| ConcealedEffect {
            id: id.into(),
            parameters: [(key.to_owned(), value)].into(),
            strength: 2.0,
        });
        SealedTruth {
            schema: "evrig.truth/1".into(),
            effects: effects.collect(),
            region: None,
            nonce: "n".into(),
        }
    }

    fn judge(truth: &SealedTruth, answer: &DiagnosisAnswer, known: &BTreeSet<String>) -> Judgement {
        let record = TrialRecord {
            schema: "evrig.trial/1".into(),
            trial: "t".into(),
            truth: truth.clone(),
            truth_sha256: String::new(),
            sensor_px: [346, 260],
            made_s: 0.0,
            diagnosed_s: 7.5,
            outcome: DiagnosisOutcome::Failed { because: String::new() },
        };
        super::judge(&record, answer, known)
    }

    fn answer(text: &str) -> DiagnosisAnswer {
        serde_json::from_str(text).unwrap()
    }

    const REFRACTORY: (&str, &str, f64) = ("refractory_period", "refractory_us", 800.0);

    #[test]
    fn a_right_answer_is_right_in_name_and_number() {
        let answer = answer(
            r#"{"verdict":"explained","effects":[{"id":"refractory_period",
            "parameters":{"refractory_us":{"value":812.0,"ci90":[790.0,835.0]}}}],
            "fit":{"share_of_excess_removed":0.95}}"#,
        );
        let judged = judge(&truth(&[REFRACTORY]), &answer, &BTreeSet::new());
        assert!(judged.is_top1 && judged.is_top1_or_equivalent);
        assert_eq!((judged.right, judged.wrong, judged.missed), (1, 0, 0));
        assert!((judged.parameters[0].relative_error - 0.015).abs() < 1e-12);
        assert_eq!(judged.parameters[0].is_covered, Some(true));
        // 12 of the 22 down to the interval's low end.
        assert!((judged.parameters[0].error_in_intervals.unwrap() - 12.0 / 22.0).abs() < 1e-12);
        assert_eq!(judged.share_removed, Some(0.95));
    }

    #[test]
    fn a_stated_equivalent_counts_apart_from_the_first_name() {
        let answer = answer(
            r#"{"verdict":"explained","effects":[{"id":"clock_offset","indistinguishable":["fixed_pole"]}]}"#,
        );
        let judged = judge(&truth(&[("fixed_pole", "cutoff_hz", 20.0)]), &answer, &BTreeSet::new());
        assert!(!judged.is_top1 && judged.is_top1_or_equivalent);
        assert_eq!((judged.right, judged.wrong, judged.missed), (1, 0, 0));
        assert!(judged.parameters.is_empty());
    }

    #[test]
    fn a_wrong_name_and_a_missed_one_are_counted() {
        let answer = answer(r#"{"verdict":"explained","effects":[{"id":"flicker"}]}"#);
        let judged = judge(&truth(&[REFRACTORY]), &answer, &BTreeSet::new());
        assert_eq!((judged.right, judged.wrong, judged.missed), (0, 1, 1));
        let clean = judge(&truth(&[]), &answer, &BTreeSet::new());
        assert_eq!((clean.right, clean.wrong, clean.missed), (0, 1, 0));
    }

    #[test]
    fn what_a_recording_is_known_to_hold_is_neither_right_nor_wrong() {
        let answer = answer(
            r#"{"verdict":"explained","effects":[{"id":"junction_leak"},{"id":"refractory_period"}]}"#,
        );
        let known = ["junction_leak".to_owned()].into();
        let judged = judge(&truth(&[REFRACTORY]), &answer, &known);
        assert!(judged.is_top1);
        assert_eq!((judged.right, judged.wrong), (1, 0));
    }

    #[test]
    fn a_region_is_judged_by_the_pixels_it_shares() {
        let mut truth = truth(&[REFRACTORY]);
        truth.region = Some(Rectangle { x_px: [0, 10], y_px: [0, 10] });
        let answer = answer(
            r#"{"verdict":"explained","effects":[{"id":"refractory_period",
            "region":{"x_px":[0,10],"y_px":[0,5]}}]}"#,
        );
        let judged = judge(&truth, &answer, &BTreeSet::new());
        assert!((judged.region_f1.unwrap() - 2.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn what_an_answer_states_it_cannot_judge_is_distinguished() {
        let text = r#"{"verdict":"no_mismatch","cannot_judge":[{"id":"refractory_period","because":"x"}]}"#;
        assert!(
            judge(&truth(&[REFRACTORY]), &answer(text), &BTreeSet::new()).is_declared_undecidable
        );
        assert!(!judge(&truth(&[]), &answer(text), &BTreeSet::new()).is_declared_undecidable);
    }
}
