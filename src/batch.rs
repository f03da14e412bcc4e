//! A dataset: a directory of sessions, processed unattended, here or on Slurm.
//!
//! ```text
//! <dataset>/
//!   <session>/, <folder>/<session>/     the sessions, at most four folders deep
//!   dataset.json                        the index: sessions, streams with counts, rigs, splits, outcomes
//!   CARD.md                             the same for people: counts, rigs, splits, losses
//!   comparison.json, .csv, .html        measures by generator variant over the sessions
//!   comparison-sessions.csv             the same session by session
//!   report.html                         all of it as a page
//!   batch/outcomes/<session>.json       the outcome of each session
//!   batch/slurm/                        the job's script, its record and its logs
//! ```
//! No file holds a time of day or a place outside the dataset, so that a run here and one on a
//! cluster leave the same bytes (`batch/slurm` apart).

mod aggregate;
mod card;
mod cluster;
mod compare;
mod index;
mod lock;
mod outcome;
mod page;
mod paper_table;
mod results;
mod run;
mod slurm;
mod split;
mod walk;

pub use aggregate::{Aggregate, MeasureMean, SessionValue, VariantMeans, aggregate};
pub use card::card;
pub use cluster::{DatasetStatus, Gathered, gather, run_task, status, submit};
pub use compare::{DatasetCompareRequest, compare_dataset};
pub use index::{Index, IndexedRig, IndexedSession, IndexedStream, NamedEffect, index, read_index};
pub use lock::{LockGuard, lock_dataset, lock_session};
pub use outcome::{
    LeftOut, OutcomeKind, SessionOutcome, clear_outcome, read_outcome, write_outcome,
};
pub use page::{comparison_page, dataset_page};
pub use paper_table::{PaperTableRequest, write_paper_table};
pub use results::{dataset_report, read_splits, write_comparison, write_results};
pub use run::{BatchProgress, OnProgress, process_dataset, process_session};
pub use slurm::{JobState, Resources, Slurm, SlurmJob, read_job};
pub use split::{SplitBy, SplitShare, Splits, stimulus};
pub use walk::{FoundSession, is_dataset, walk};

use crate::pipeline::PipelineError;
use evrig_session::SessionError;
use std::path::{Path, PathBuf};

/// Why a dataset cannot be processed.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// There is no session in it.
    #[error("{root} is no dataset: {what}", root = root.display())]
    NoDataset {
        /// The directory.
        root: PathBuf,
        /// What is missing and what to do.
        what: String,
    },
    /// Another process has it.
    #[error(
        "{path} is being processed by {whom}; wait for its end, or stop that one first",
        path = path.display()
    )]
    Busy {
        /// The dataset or the session.
        path: PathBuf,
        /// Who holds the lock.
        whom: String,
    },
    /// Nothing can be written to it.
    #[error(
        "{path}: {source}; results are written beside the recordings: copy them to a writable \
         disk with free space",
        path = path.display()
    )]
    NoRoom {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// Shares that make no split.
    #[error("splits `{text}`: {what}; expected as train=0.8,val=0.1,test=0.1")]
    Splits {
        /// What was given.
        text: String,
        /// What is wrong.
        what: String,
    },
    /// A file of the dataset cannot be understood.
    #[error("{path}: {what}", path = path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// Slurm did not do what was asked.
    #[error("{command}: {what}")]
    Slurm {
        /// The command.
        command: String,
        /// Its message.
        what: String,
    },
    /// The disk refuses, which concerns every session.
    #[error("{session}: the run over the dataset was stopped, because the disk refuses: {source}")]
    Disk {
        /// The session.
        session: String,
        /// What the disk refused.
        source: Box<BatchError>,
    },
    /// A stage failed, or the request is wrong.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A session or a file cannot be read or written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The system refused.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

impl BatchError {
    /// The system's refusal; a disk that is full or read-only is a variant of its own.
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| {
            let path = path.to_owned();
            if is_disk(&source) { Self::NoRoom { path, source } } else { Self::Io { path, source } }
        }
    }
}

/// Whether the disk is at fault, so that no other session would fare better.
#[must_use]
pub fn is_disk(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    matches!(error.kind(), StorageFull | ReadOnlyFilesystem | QuotaExceeded)
}
