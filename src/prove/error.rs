//! Why a run of trials stops.

use super::plasmode::PlasmodeError;
use super::record::ProofFolderError;
use super::seal::SealError;
use evrig_session::SessionError;
use evrig_sim::SimulateError;
use std::path::PathBuf;

/// Why trials cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum ProveError {
    /// A seal cannot be set or does not hold.
    #[error(transparent)]
    Seal(#[from] SealError),
    /// A simulated session cannot be made.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// A recording cannot be changed.
    #[error(transparent)]
    Plasmode(#[from] PlasmodeError),
    /// A session cannot be made or read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The run's own files cannot be written or read.
    #[error(transparent)]
    Record(#[from] ProofFolderError),
    /// An answer is no diagnosis.
    #[error("{trial}: the answer is no diagnosis: {source}")]
    Answer {
        /// The trial.
        trial: String,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// A folder of ready sessions holds none.
    #[error(
        "{}: no sealed session in it; expected sessions/NAME/seal.json and truth/NAME.json, as \
         the example third_party_trials makes them", path.display()
    )]
    NoneReady {
        /// The folder.
        path: PathBuf,
    },
    /// The rig or the trajectory of the trials is wrong.
    #[error("{what}: {because}")]
    Description {
        /// Which.
        what: String,
        /// Why.
        because: String,
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
