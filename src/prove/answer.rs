//! The part of a `diagnosis.json` that is judged.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What of a `diagnosis.json` is judged.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisAnswer {
    /// `no_mismatch`, `explained`, `partly_explained` or `unexplained`.
    pub verdict: String,
    /// The effects named, in the order of importance.
    #[serde(default)]
    pub effects: Vec<AnsweredEffect>,
    /// Strata in which the model is wrong.
    #[serde(default)]
    pub mismatch: AnswerMismatch,
    /// Fit of the named effects to held-out data.
    #[serde(default)]
    pub fit: AnswerFit,
    /// Effects that cannot be judged from this session.
    #[serde(default)]
    pub cannot_judge: Vec<UndecidableEffect>,
}

/// The part of the mismatch that is judged.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AnswerMismatch {
    /// Strata, the worst first.
    #[serde(rename = "where", default)]
    pub places: Vec<MismatchStratum>,
}

/// A stratum in which the answer reports a mismatch.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MismatchStratum {
    /// Its covariate.
    pub covariate: String,
    /// Its range.
    pub range: [f64; 2],
    /// Excess log-loss of the model there, nats per event.
    pub excess_nats_per_event: f64,
}

/// An effect that an answer does not judge.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct UndecidableEffect {
    /// Its id.
    pub id: String,
}

/// An effect as an answer names it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AnsweredEffect {
    /// Its id.
    pub id: String,
    /// Its parameters.
    #[serde(default)]
    pub parameters: BTreeMap<String, AnswerParameter>,
    /// Pixels to which it is limited.
    #[serde(default)]
    pub region: Option<serde_json::Value>,
    /// Effects that fit as well.
    #[serde(default, alias = "equivalent")]
    pub indistinguishable: Vec<String>,
    /// Log-likelihood gain, nats per held-out event.
    #[serde(default)]
    pub heldout_gain_nats_per_event: Option<f64>,
}

/// A parameter as an answer states it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AnswerParameter {
    /// The value.
    pub value: Option<f64>,
    /// Its 90 % interval.
    #[serde(default)]
    pub ci90: Option<[Option<f64>; 2]>,
}

/// The part of the fit that is judged.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AnswerFit {
    /// Share of the excess that the effects named removed.
    #[serde(default)]
    pub share_of_excess_removed: Option<f64>,
}
