//! Files of a run: its plan, and a record of each trial as soon as it is judged.

use super::answer::DiagnosisAnswer;
use super::draw::TrialMix;
use super::truth::{Family, SealedTruth};
use evrig_analysis::diagnose::DiagnosisOptions;
use evrig_core::stats::read_back;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Why a folder cannot be used for a run.
#[derive(Debug, thiserror::Error)]
pub enum ProofFolderError {
    /// The folder holds another run.
    #[error(
        "{}: the folder holds a run already; resume it with --resume, or choose another folder \
         with --out",
        path.display()
    )]
    Taken {
        /// The plan that is there.
        path: PathBuf,
    },
    /// The folder holds no run to resume.
    #[error("{}: the folder holds no run to resume; omit --resume to begin one", path.display())]
    Nothing {
        /// Where its plan would be.
        path: PathBuf,
    },
    /// The folder holds a run with another plan.
    #[error(
        "{}: `{key}` is {there} in the folder and {here} in this call; a run is resumed only with \
         its own plan",
        path.display()
    )]
    OtherPlan {
        /// The plan that is there.
        path: PathBuf,
        /// What differs.
        key: String,
        /// As it is there, in JSON.
        there: String,
        /// As it was asked for, in JSON.
        here: String,
    },
    /// A file of the run is not what it should be.
    #[error("{}: {what}; remove it, and its trial is run again", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

/// The plan of a run. It does not reveal what is concealed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProofPlan {
    /// `evrig.proof-plan/2`.
    pub schema: String,
    /// Whose sessions.
    pub family: Family,
    /// How many trials of each kind; none when the sessions were made elsewhere.
    pub mix: Option<TrialMix>,
    /// Seed of the plan.
    pub seed: u64,
    /// Seconds of a simulated session.
    pub seconds: Option<f64>,
    /// Options of the diagnosis.
    pub options: DiagnosisOptions,
    /// SHA-256 of the drawn trials: another version may draw others from the same seed.
    pub trials_sha256: String,
}

/// Outcome of a diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "ended", rename_all = "snake_case")]
pub enum DiagnosisOutcome {
    /// With an answer: `diagnosis.json` as it is.
    Answered {
        /// The document.
        diagnosis: Value,
    },
    /// It refused the session.
    Failed {
        /// Its message.
        because: String,
    },
    /// It was stopped.
    OutOfTime {
        /// After so many seconds.
        after_s: f64,
    },
}

impl DiagnosisOutcome {
    /// What is judged: no answer names nothing, and its verdict states why.
    ///
    /// # Errors
    /// When the document is no diagnosis.
    pub fn answer(&self) -> Result<DiagnosisAnswer, serde_json::Error> {
        let silent = |verdict: &str| DiagnosisAnswer {
            verdict: verdict.into(),
            ..DiagnosisAnswer::default()
        };
        match self {
            Self::Answered { diagnosis } => DiagnosisAnswer::deserialize(diagnosis),
            Self::Failed { .. } => Ok(silent("failed")),
            Self::OutOfTime { .. } => Ok(silent("out_of_time")),
        }
    }
}

/// A trial after its seal was opened, with all that its judgement needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialRecord {
    /// `evrig.trial/1`.
    pub schema: String,
    /// The trial's name.
    pub trial: String,
    /// What was concealed.
    pub truth: SealedTruth,
    /// SHA-256 of the truth, as sealed before the diagnosis.
    pub truth_sha256: String,
    /// The event camera's columns and rows.
    pub sensor_px: [u16; 2],
    /// Seconds it took to make the session.
    pub made_s: f64,
    /// Seconds the diagnosis took, with the stages before it.
    pub diagnosed_s: f64,
    /// Outcome of the diagnosis.
    pub outcome: DiagnosisOutcome,
}

/// Takes a folder for a run: a new one, or with `is_resumed` one in which this plan was begun.
///
/// # Errors
/// When a run is there and is not to be gone on with, or has another plan; when one is to be gone
/// on with and there is none; when the disk refuses.
pub fn claim_folder(
    out: &Path,
    plan: &ProofPlan,
    is_resumed: bool,
) -> Result<(), ProofFolderError> {
    let path = out.join("plan.json");
    let there = match (read::<Value>(&path)?, is_resumed) {
        (None, false) => return write(&path, plan),
        (None, true) => return Err(ProofFolderError::Nothing { path }),
        (Some(_), false) => return Err(ProofFolderError::Taken { path }),
        (Some(there), true) => there,
    };
    let here = value(plan, &path)?;
    let keys = here.as_object().into_iter().flatten();
    for (key, here) in keys {
        let there = there.get(key).unwrap_or(&Value::Null);
        if there != here {
            let (key, there, here) = (key.clone(), there.to_string(), here.to_string());
            return Err(ProofFolderError::OtherPlan { path, key, there, here });
        }
    }
    Ok(())
}

/// Reads a file of a run; `None` when there is none.
///
/// # Errors
/// When it is there and cannot be read.
pub(super) fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ProofFolderError> {
    let text = match std::fs::read_to_string(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        text => text.map_err(|source| ProofFolderError::Io { path: path.to_owned(), source })?,
    };
    let what = |error: serde_json::Error| error.to_string();
    read_back(&text)
        .map(Some)
        .map_err(|e| ProofFolderError::Format { path: path.to_owned(), what: what(e) })
}

/// Writes a file of a run so that it is there whole or not at all.
///
/// # Errors
/// When the disk refuses.
pub(super) fn write<T: Serialize>(path: &Path, content: &T) -> Result<(), ProofFolderError> {
    let text = serde_json::to_string_pretty(&value(content, path)?).unwrap_or_default();
    write_text(path, &text)
}

/// The same for text.
///
/// # Errors
/// When the disk refuses.
pub(super) fn write_text(path: &Path, text: &str) -> Result<(), ProofFolderError> {
    let io = |source| ProofFolderError::Io { path: path.to_owned(), source };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(io)?;
    }
    let partial = path.with_extension("partial");
    std::fs::write(&partial, text).map_err(io)?;
    std::fs::rename(&partial, path).map_err(io)
}

fn value<T: Serialize>(content: &T, path: &Path) -> Result<Value, ProofFolderError> {
    serde_json::to_value(content)
        .map_err(|e| ProofFolderError::Format { path: path.to_owned(), what: e.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(seed: u64) -> ProofPlan {
        ProofPlan {
            schema: "evrig.proof-plan/2".into(),
            family: Family::World,
            mix: None,
            seed,
            seconds: Some(2.6),
            options: DiagnosisOptions::default(),
            trials_sha256: "s".into(),
        }
    }

    #[test]
    fn a_run_goes_on_only_when_asked_to_and_only_with_its_own_plan() {
        let folder = tempfile::tempdir().unwrap();
        claim_folder(folder.path(), &plan(1), false).unwrap();
        claim_folder(folder.path(), &plan(1), true).unwrap();
        let error = claim_folder(folder.path(), &plan(1), false).unwrap_err();
        assert!(matches!(error, ProofFolderError::Taken { .. }), "{error}");
        let error = claim_folder(folder.path(), &plan(2), true).unwrap_err().to_string();
        assert!(error.contains("`seed` is 1 in the folder and 2 in this call"), "{error}");
    }

    #[test]
    fn a_file_that_is_no_record_is_named_and_a_missing_one_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trials/world-000.json");
        assert_eq!(read::<TrialRecord>(&path).unwrap(), None);
        write_text(&path, "{\"schema\": \"evrig.tri").unwrap();
        let error = read::<TrialRecord>(&path).unwrap_err().to_string();
        assert!(error.contains("world-000.json") && error.contains("run again"), "{error}");
    }

    #[test]
    fn no_answer_names_nothing_and_states_why() {
        let late = DiagnosisOutcome::OutOfTime { after_s: 60.0 }.answer().unwrap();
        assert_eq!((late.verdict.as_str(), late.effects.len()), ("out_of_time", 0));
        let refused =
            DiagnosisOutcome::Failed { because: "too few events".into() }.answer().unwrap();
        assert_eq!(refused.verdict, "failed");
        let wrong = DiagnosisOutcome::Answered { diagnosis: serde_json::json!([1]) };
        assert!(wrong.answer().is_err());
    }
}
