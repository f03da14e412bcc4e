//! The result: `diagnosis.json`.

use crate::diagnose::BeforeAfter;
use evrig_core::effect_id::EffectId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The model holds.
    NoMismatch,
    /// Named effects remove at least half of the excess.
    Explained,
    /// Named effects remove a good part of the excess.
    PartlyExplained,
    /// Nothing in the library removes a good part of the excess.
    Unexplained,
}

/// A value with the interval that covers the truth in 90 % of repetitions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The value.
    pub value: f64,
    /// Its interval; `null` ends where it is not known.
    pub ci90: [Option<f64>; 2],
}

/// A stratum in which the model is wrong.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Where {
    /// What the stratum is by.
    pub covariate: String,
    /// Its range.
    pub range: [f64; 2],
    /// What a recalibration in it would buy, nats an event of all.
    pub excess_nats_per_event: f64,
    /// Mean of what the light had changed beyond the threshold, in thresholds: late above 0; none
    /// where numbers of events are compared.
    pub innovation_thresholds: Option<f64>,
    /// Real events for each of the model's, where numbers of events are compared.
    #[serde(default)]
    pub ratio: Option<f64>,
    /// Events in it.
    pub n_events: u64,
    /// In words.
    pub says: String,
}

/// Whether the baseline falls short.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mismatch {
    /// Ceiling minus baseline.
    pub excess_nats_per_event: f64,
    /// Chance of as much without any mismatch, by the scatter over cells.
    pub p_value: f64,
    /// Where, the worst first.
    #[serde(rename = "where")]
    pub places: Vec<Where>,
}

/// Another effect in the same place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rival {
    /// Its id.
    pub id: EffectId,
    /// What it would have bought instead.
    pub heldout_gain_nats_per_event: f64,
}

/// An effect that was named.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FittedEffect {
    /// Its id.
    pub id: EffectId,
    /// Its name.
    pub name: String,
    /// Its equation.
    pub equation: String,
    /// What was found, in a sentence.
    pub says: String,
    /// Its parameters.
    pub parameters: BTreeMap<String, Interval>,
    /// What it buys on held-out cells on top of the effects above it.
    pub heldout_gain_nats_per_event: f64,
    /// Standard error of that gain.
    pub heldout_gain_error: f64,
    /// Chance of such a gain anywhere in the library without the effect.
    pub p_value: f64,
    /// Pixels or times it is limited to; `null` for everywhere.
    pub region: Option<serde_json::Value>,
    /// Effects whose score is below this one's by less than a name takes, or that no events tell apart.
    pub equivalent: Vec<EffectId>,
    /// What else was tried in its place, the best first.
    pub rivals: Vec<Rival>,
}

impl FittedEffect {
    /// Whether no predicted event depends on it: a census or the frames show it, and the score is the same
    /// with and without.
    #[must_use]
    pub fn is_beside_the_score(&self) -> bool {
        self.heldout_gain_nats_per_event == 0.0 && self.heldout_gain_error == 0.0
    }
}

/// Scores on held-out cells, nats an event.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Nuisances alone.
    pub baseline: f64,
    /// With the named effects.
    pub r#final: f64,
    /// The best that was reached in any way.
    pub ceiling: f64,
    /// What reached it.
    pub ceiling_is: String,
}

/// How much better the model has become.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Scores.
    pub heldout_nats_per_event: HeldOut,
    /// Final minus baseline over ceiling minus baseline; `null` without an excess.
    pub share_of_excess_removed: Option<f64>,
    /// The generator let run by itself, against the camera; empty where it was not.
    pub forward: BTreeMap<String, BeforeAfter>,
}

/// What the named effects leave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Leftover {
    /// Ceiling minus final.
    pub excess_nats_per_event: f64,
    /// Chance of as much without any mismatch.
    pub p_value: f64,
    /// Where.
    #[serde(rename = "where")]
    pub places: Vec<Where>,
}

/// What the search finds where there is nothing; that is not asked behind a model that leaves nearly all that was to be
/// explained.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct NullReport {
    /// Recordings drawn from the final model.
    pub n: usize,
    /// The greatest held-out gain of any effect in each.
    pub greatest_gains: Vec<f64>,
    /// The gain an effect has to beat to be named.
    pub bar_nats_per_event: f64,
    /// What trees tell a model's events by in recordings drawn from it, nats an event.
    #[serde(default)]
    pub structures_nats_per_event: Vec<f64>,
}

/// What is left to tell a model's events from the camera's, each behind the same past.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StructureLeft {
    /// What trees that have not seen them gain over a coin, nats an event; 0.69 at most.
    pub nats_per_event: f64,
    /// Its standard error.
    pub error: f64,
    /// What they gain by nothing that an error of the light shows in (neither the light nor the neighbours), where
    /// the light between frames is guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nats_apart_from_light: Option<f64>,
    /// Share they tell rightly; a half where nothing is left.
    pub accuracy: f64,
    /// By what, the most telling first.
    pub told_by: Vec<String>,
}

/// An effect that fits and does not hold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Suspect {
    /// Its id.
    pub id: EffectId,
    /// What it would buy on held-out cells.
    pub heldout_gain_nats_per_event: f64,
    /// Why it is not named.
    pub because: String,
}

/// The structure that two models leave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StructureReport {
    /// Nuisances alone.
    pub baseline: StructureLeft,
    /// With all effects that were taken, named or not.
    pub r#final: StructureLeft,
}

/// The named effects on a half of the recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Half {
    /// Which half.
    pub of: String,
    /// Events in it.
    pub n_events: usize,
    /// What the effects together buy there on held-out cells.
    pub heldout_gain_nats_per_event: f64,
    /// Its standard error.
    pub heldout_gain_error: f64,
    /// Their parameters, `effect.key`.
    pub parameters: BTreeMap<String, f64>,
}

/// A term outside the library.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProposedTerm {
    /// `drive`, `drift`, `threshold`, `time_stamp` or `hazard`.
    pub enters: String,
    /// The covariate it depends on.
    pub depends_on: String,
    /// Covariate, mean innovation in thresholds, low and high end of its 90 % band.
    pub curve: Vec<[f64; 4]>,
    /// What a hazard recalibrated by that covariate buys on held-out cells.
    pub heldout_gain_nats_per_event: f64,
}

/// An effect that this session says nothing about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CannotJudge {
    /// The effect.
    pub id: EffectId,
    /// Why.
    pub because: String,
}

/// `diagnosis.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// `evrig.diagnosis/1`.
    pub schema: String,
    /// In a word.
    pub verdict: Verdict,
    /// Whether and where the baseline falls short.
    pub mismatch: Mismatch,
    /// Named effects in the order of importance.
    pub effects: Vec<FittedEffect>,
    /// Nuisances of the final model.
    pub nuisances: BTreeMap<String, Interval>,
    /// How much better the model has become.
    pub fit: FitReport,
    /// What is left.
    pub leftover: Leftover,
    /// A term that would help where nothing in the library does.
    pub proposed_term: Option<ProposedTerm>,
    /// What to record to tell equivalent effects apart.
    pub next_recording: Option<String>,
    /// Effects this session says nothing about.
    pub cannot_judge: Vec<CannotJudge>,
    /// Effects that fit better than nothing, and whose model yet leaves what it should have removed:
    /// not named.
    #[serde(default)]
    pub suspects: Vec<Suspect>,
    /// Agreement of halves of the pixels and of the time.
    #[serde(default)]
    pub halves: Vec<Half>,
    /// Where the recording's stamps lie on a coarse grid: its step, microseconds. Events were spread
    /// evenly over it, and nothing finer can be told.
    #[serde(default)]
    pub stamp_step_us: Option<f64>,
    /// What baseline and final model leave to be told apart; `null` with too few events.
    #[serde(default)]
    pub structure: Option<StructureReport>,
    /// The search's own noise.
    pub null: NullReport,
    /// Pixels and events looked at.
    pub n_pixels: usize,
    /// Events of those pixels.
    pub n_events: usize,
}

impl Diagnosis {
    /// The share of the excess that named effects remove; none where nothing is named that a predicted event
    /// depends on, since what the final model then gains or loses is no effect's.
    #[must_use]
    pub fn share_removed(&self) -> Option<f64> {
        let is_scored = !self.effects.iter().all(FittedEffect::is_beside_the_score);
        self.fit.share_of_excess_removed.filter(|_| is_scored)
    }

    /// What coarse stamps mean for the diagnosis, in a sentence.
    #[must_use]
    pub fn coarse_stamps(&self) -> Option<String> {
        let step_us = self.stamp_step_us?;
        Some(format!(
            "The events' stamps lie on a grid of {step_us:.1} us, as a simulator that works in steps \
             gives them. They were spread evenly over it; nothing finer can be told."
        ))
    }
}
