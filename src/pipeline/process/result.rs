//! What a run of all stages gives: each stage's result, or why it was left out.

use crate::pipeline::{
    CalibrateRequest, CompareRequest, FilterRequest, FilteredStream, Freshness, GenerateRequest,
    Generated, SceneMade, Synced, TrackRequest, Tracked, VariantResults,
};
use evrig_analysis::calibrate::Calibration;
use evrig_analysis::compare::Comparison;
use evrig_analysis::diagnose::Diagnosis;
use evrig_session::DataLoss;

/// A session of which all stages were run.
#[derive(Debug)]
pub struct Processed {
    /// Name of the session.
    pub session: String,
    /// The stages in the order in which they were run.
    pub steps: Vec<ProcessStep>,
    /// Losses of the recording.
    pub losses: Vec<DataLoss>,
    /// Losses of the recording, and stages that had their inputs and failed, or lost some of them.
    pub n_lost: usize,
}

/// A stage that was run or left out.
#[derive(Debug)]
pub enum ProcessStep {
    /// It has a result.
    Done(Box<StageResult>),
    /// It has none.
    Skipped(SkippedStage),
}

/// A stage without a result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SkippedStage {
    /// The stage.
    pub stage: &'static str,
    /// Why.
    pub because: String,
}

/// The typed result of a stage with the request that led to it.
#[derive(Debug)]
pub enum StageResult {
    /// The clocks.
    Sync(Box<Synced>),
    /// The track of the tag in one stream.
    Track(TrackRequest, Box<Tracked>),
    /// The scene.
    Scene(SceneMade),
    /// The generator's constants.
    Calibrate(CalibrateRequest, Calibration, Freshness),
    /// A generated stream.
    Generate(GenerateRequest, Generated),
    /// A filtered stream.
    Filter(FilterRequest, FilteredStream),
    /// A list of variants.
    Variants(VariantResults),
    /// A comparison.
    Compare(CompareRequest, Comparison, Freshness),
    /// The diagnosis.
    Diagnose(Diagnosis),
}

impl StageResult {
    /// Name of the stage.
    #[must_use]
    pub const fn stage(&self) -> &'static str {
        match self {
            Self::Sync(..) => "sync",
            Self::Track(..) => "track",
            Self::Scene(..) => "scene",
            Self::Calibrate(..) => "calibrate",
            Self::Generate(..) => "generate",
            Self::Filter(..) => "filter",
            Self::Variants(..) => "variants",
            Self::Compare(..) => "compare",
            Self::Diagnose(..) => "diagnose",
        }
    }
}

impl Processed {
    /// Results of the stages that ran.
    pub fn results(&self) -> impl Iterator<Item = &StageResult> {
        self.steps.iter().filter_map(|step| match step {
            ProcessStep::Done(result) => Some(result.as_ref()),
            ProcessStep::Skipped(_) => None,
        })
    }

    /// Stages that were left out.
    pub fn skipped(&self) -> impl Iterator<Item = &SkippedStage> {
        self.steps.iter().filter_map(|step| match step {
            ProcessStep::Done(_) => None,
            ProcessStep::Skipped(skipped) => Some(skipped),
        })
    }
}
