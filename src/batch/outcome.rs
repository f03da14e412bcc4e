//! The outcome of each session: `batch/outcomes/<session>.json`.

use super::BatchError;
use evrig_session::write_whole;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How the processing of a session ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OutcomeKind {
    /// Every stage that had its inputs ran.
    Ok,
    /// The same, but something of the recording or of a stage was lost.
    WithLosses,
    /// It could not be processed.
    Failed,
}

impl std::fmt::Display for OutcomeKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Ok => "ok",
            Self::WithLosses => "with losses",
            Self::Failed => "failed",
        })
    }
}

/// The outcome of a session.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SessionOutcome {
    /// `evrig.outcome/1`.
    pub schema: String,
    /// The session's path in the dataset.
    pub session: String,
    /// How it ended.
    pub verdict: OutcomeKind,
    /// What was lost, or why it failed.
    pub because: Vec<String>,
    /// Number of stage results.
    pub n_stages: u64,
    /// Stages without input, or without a result.
    pub left_out: Vec<LeftOut>,
    /// The version that ran them.
    pub evrig_version: String,
}

/// A stage that was left out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// The stage.
    pub stage: String,
    /// Why.
    pub because: String,
}

impl SessionOutcome {
    /// The outcome in a line.
    #[must_use]
    pub fn summary(&self) -> String {
        if self.because.is_empty() {
            format!("{} ({} stages)", self.verdict, self.n_stages)
        } else {
            format!("{}: {}", self.verdict, self.because.join("; "))
        }
    }

    /// The outcome of a session that could not be processed.
    #[must_use]
    pub fn failed(session: &str, because: String) -> Self {
        Self {
            schema: "evrig.outcome/1".into(),
            session: session.into(),
            verdict: OutcomeKind::Failed,
            because: vec![because],
            n_stages: 0,
            left_out: Vec::new(),
            evrig_version: env!("CARGO_PKG_VERSION").into(),
        }
    }
}

fn path(root: &Path, session: &str) -> PathBuf {
    root.join("batch/outcomes").join(format!("{session}.json"))
}

/// The outcome of a session's last run; none when there was none, or it was cut off.
#[must_use]
pub fn read_outcome(root: &Path, session: &str) -> Option<SessionOutcome> {
    let text = std::fs::read_to_string(path(root, session)).ok()?;
    serde_json::from_str(&text).ok()
}

/// Forgets the outcome of a session, so that a run that is cut off leaves none.
///
/// # Errors
/// When the disk refuses.
pub fn clear_outcome(root: &Path, session: &str) -> Result<(), BatchError> {
    let path = path(root, session);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(BatchError::io(&path)(error))
        }
        _ => Ok(()),
    }
}

/// Writes the outcome of a session, whole or not at all.
///
/// # Errors
/// When the disk refuses.
pub fn write_outcome(root: &Path, outcome: &SessionOutcome) -> Result<(), BatchError> {
    let path = path(root, &outcome.session);
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(BatchError::io(folder))?;
    }
    let text = serde_json::to_string_pretty(outcome)
        .map_err(|e| BatchError::Malformed { path: path.clone(), what: e.to_string() })?;
    Ok(write_whole(&path, text.as_bytes())?)
}
