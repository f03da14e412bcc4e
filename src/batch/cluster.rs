//! A dataset on Slurm: submission, the run of one task, and the job after the tasks.

use super::run::{process_found, to_process};
use super::{
    Aggregate, BatchError, Index, JobState, OnProgress, Resources, SessionOutcome, Slurm, SlurmJob,
    SplitBy, Splits, clear_outcome, lock_dataset, read_job, read_outcome, slurm, walk,
    write_outcome, write_results,
};
use crate::pipeline::ProcessRequest;
use std::collections::BTreeMap;
use std::path::Path;

/// Submits a task for each session and a job that gathers their outcomes; none where every session
/// has its outcome.
///
/// # Errors
/// When the dataset is locked or being processed on Slurm, or `sbatch` refuses.
pub fn submit(
    root: &Path,
    request: &ProcessRequest,
    splits: &Splits,
    only_failed: bool,
    resources: Resources,
    max_attempts: u32,
) -> Result<Option<SlurmJob>, BatchError> {
    let _held = lock_dataset(root)?;
    slurm::refuse_if_under_way(root)?;
    let found = walk(root)?;
    let chosen = to_process(root, &found, only_failed);
    if chosen.is_empty() {
        return Ok(None);
    }
    let job = SlurmJob {
        schema: "evrig.slurm-job/1".into(),
        sessions: chosen.iter().map(|one| one.key.clone()).collect(),
        arrays: Vec::new(),
        gather: None,
        attempt: 1,
        max_attempts,
        arguments: arguments(request, splits)?,
        resources,
    };
    send(root, job).map(Some)
}

fn arguments(request: &ProcessRequest, splits: &Splits) -> Result<Vec<String>, BatchError> {
    let mut arguments = request.choice.arguments();
    arguments.push(format!("--splits={}", splits.text()));
    arguments.push(format!("--split-seed={}", splits.seed()));
    if splits.by() == SplitBy::Stimulus {
        arguments.push("--split-by=stimulus".into());
    }
    if let Some(list) = &request.variants {
        arguments.push(format!("--variants={}", list.argument()?));
    }
    if request.force {
        arguments.push("--force".into());
    }
    Ok(arguments)
}

/// Submits a job. Where Slurm accepts none of it, the dataset has the state from before.
fn send(root: &Path, job: SlurmJob) -> Result<SlurmJob, BatchError> {
    let slurm = Slurm::new(root)?;
    let former = read_job(root)?;
    let sessions = job.sessions.clone();
    let outcomes: Vec<SessionOutcome> =
        sessions.iter().filter_map(|session| read_outcome(root, session)).collect();
    for session in &sessions {
        clear_outcome(root, session)?;
    }
    let sent = slurm.submit(job);
    let is_accepted = read_job(root)?.is_some_and(|job| !job.arrays.is_empty());
    if sent.is_err() && !is_accepted {
        slurm.withdraw(former.as_ref())?;
        outcomes.iter().try_for_each(|outcome| write_outcome(root, outcome))?;
    }
    sent
}

fn submitted(root: &Path) -> Result<SlurmJob, BatchError> {
    read_job(root)?.ok_or_else(|| BatchError::Slurm {
        command: "evrig process".into(),
        what: "nothing was submitted for this dataset".into(),
    })
}

/// Processes the session of one task.
///
/// # Errors
/// When there is no such task, or the disk refuses.
pub fn run_task(
    root: &Path,
    number: usize,
    request: &ProcessRequest,
    progress: OnProgress<'_>,
) -> Result<SessionOutcome, BatchError> {
    let job = submitted(root)?;
    let key = job.sessions.get(number).ok_or_else(|| BatchError::Slurm {
        command: format!("task {number}"),
        what: format!("{} sessions were submitted", job.sessions.len()),
    })?;
    if let Some(one) = walk(root)?.iter().find(|one| one.key == *key) {
        return process_found(root, one, request, progress);
    }
    let gone = SessionOutcome::failed(key, "the session no longer exists".into());
    write_outcome(root, &gone)?;
    Ok(gone)
}

/// What the job after the tasks did.
#[derive(Debug)]
pub enum Gathered {
    /// Tasks that a fault of the machine ended were submitted again.
    Resubmitted(SlurmJob),
    /// Every task has its outcome; the dataset's files were written.
    Complete(Box<(Index, Aggregate)>),
}

/// Submits the tasks again that a fault of the machine ended; writes the dataset's files where
/// every task has its outcome.
///
/// # Errors
/// When nothing was submitted, the dataset is locked, or Slurm does not answer.
pub fn gather(root: &Path, splits: &Splits, seed: u64) -> Result<Gathered, BatchError> {
    let _held = lock_dataset(root)?;
    let job = submitted(root)?;
    let states = Slurm::new(root)?.states(&job)?;
    let mut again = Vec::new();
    for session in &job.sessions {
        if read_outcome(root, session).is_some() {
            continue;
        }
        match final_failure(&job, states.get(session).copied()) {
            Some(because) => write_outcome(root, &SessionOutcome::failed(session, because))?,
            None => again.push(session.clone()),
        }
    }
    if again.is_empty() {
        return Ok(Gathered::Complete(Box::new(write_results(root, splits, seed)?)));
    }
    let job = SlurmJob { sessions: again, attempt: job.attempt + 1, ..job };
    send(root, job).map(Gathered::Resubmitted)
}

/// Why a task without an outcome is not tried again; none if it is.
fn final_failure(job: &SlurmJob, state: Option<JobState>) -> Option<String> {
    let Resources { time_limit, memory, .. } = &job.resources;
    match state {
        Some(JobState::Cancelled) => Some("its task was cancelled".into()),
        Some(JobState::OutOfTime) => Some(format!(
            "its task ran out of its time of {time_limit}; give more with --time-limit"
        )),
        Some(JobState::OutOfMemory) => {
            Some(format!("its task ran out of its memory of {memory}; give more with --memory"))
        }
        _ if job.attempt >= job.max_attempts => Some(format!(
            "its task was cut off, at attempt {} of {}; see batch/slurm/logs",
            job.attempt, job.max_attempts
        )),
        _ => None,
    }
}

/// The state of a dataset's sessions.
#[derive(Debug)]
pub struct DatasetStatus {
    /// Each session with its outcome and its task's state, as far as there are any.
    pub sessions: Vec<(String, Option<SessionOutcome>, Option<JobState>)>,
    /// What was last submitted.
    pub job: Option<SlurmJob>,
    /// Why Slurm did not answer, as on a machine to which the dataset was copied.
    pub slurm_error: Option<String>,
}

/// Outcomes of a dataset's sessions, and the states of its tasks.
///
/// # Errors
/// When the dataset cannot be read.
pub fn status(root: &Path) -> Result<DatasetStatus, BatchError> {
    let found = walk(root)?;
    let job = read_job(root)?;
    let states = match &job {
        Some(job) => Slurm::new(root).and_then(|slurm| slurm.states(job)),
        None => Ok(BTreeMap::new()),
    };
    let (states, slurm_error) = match states {
        Ok(states) => (states, None),
        Err(error) => (BTreeMap::new(), Some(error.to_string())),
    };
    let of = |key: String| {
        let (outcome, state) = (read_outcome(root, &key), states.get(&key).copied());
        (key, outcome, state)
    };
    let sessions = found.into_iter().map(|one| of(one.key)).collect();
    Ok(DatasetStatus { sessions, job, slurm_error })
}
