//! The sessions of a dataset one after another; a session that fails does not stop the others.

use super::{
    Aggregate, BatchError, FoundSession, Index, LeftOut, OutcomeKind, SessionOutcome, Splits,
    clear_outcome, is_disk, lock_dataset, lock_session, read_outcome, slurm, walk, write_outcome,
    write_results,
};
use crate::pipeline::{self, PipelineProgress, ProcessRequest, Processed};
use evrig_session::Session;
use std::error::Error;
use std::panic::AssertUnwindSafe;
use std::path::Path;

/// What a run over a dataset reports to its caller.
#[derive(Debug, Clone, Copy)]
pub enum BatchProgress<'a> {
    /// Number of sessions to process.
    Sessions(u64),
    /// A session is begun.
    Begun(&'a str),
    /// A session has its outcome.
    Ended(&'a SessionOutcome),
    /// A session was compared.
    Compared(&'a str),
    /// Progress within a session.
    Stage(PipelineProgress<'a>),
}

/// Receiver of [`BatchProgress`].
pub type OnProgress<'a> = &'a (dyn Fn(BatchProgress<'_>) + Sync);

/// Runs every stage of one session under its lock.
///
/// # Errors
/// When the session cannot be opened or is locked, or as [`pipeline::process`].
pub fn process_session(
    path: &Path,
    request: &ProcessRequest,
    progress: &(dyn Fn(PipelineProgress<'_>) + Sync),
) -> Result<Processed, BatchError> {
    let session = Session::open(path)?;
    let _held = lock_session(&session)?;
    Ok(pipeline::process(&session, request, progress)?)
}

/// Processes the sessions of a dataset and writes its index, card, comparison and report.
///
/// # Errors
/// When the dataset is locked or being processed on Slurm, or the disk refuses.
pub fn process_dataset(
    root: &Path,
    request: &ProcessRequest,
    splits: &Splits,
    only_failed: bool,
    progress: OnProgress<'_>,
) -> Result<(Index, Aggregate), BatchError> {
    let _held = lock_dataset(root)?;
    slurm::refuse_if_under_way(root)?;
    let found = walk(root)?;
    let chosen = to_process(root, &found, only_failed);
    progress(BatchProgress::Sessions(chosen.len() as u64));
    for one in chosen {
        progress(BatchProgress::Begun(&one.key));
        let outcome = process_found(root, one, request, progress)?;
        progress(BatchProgress::Ended(&outcome));
    }
    write_results(root, splits, request.choice.seed)
}

/// The sessions to process: all, or those without an outcome or with a failure.
pub(super) fn to_process<'a>(
    root: &Path,
    found: &'a [FoundSession],
    only_failed: bool,
) -> Vec<&'a FoundSession> {
    let has_failed = |one: &&FoundSession| {
        read_outcome(root, &one.key).is_none_or(|outcome| outcome.verdict == OutcomeKind::Failed)
    };
    found.iter().filter(|one| !only_failed || has_failed(one)).collect()
}

/// Processes one session of a dataset, writes its report and its outcome.
///
/// # Errors
/// [`BatchError::Disk`] when the disk refuses, which would stop every other session too.
pub(super) fn process_found(
    root: &Path,
    one: &FoundSession,
    request: &ProcessRequest,
    progress: OnProgress<'_>,
) -> Result<SessionOutcome, BatchError> {
    clear_outcome(root, &one.key)?;
    let outcome = match &one.session {
        Err(because) => SessionOutcome::failed(&one.key, because.clone()),
        Ok(_) => {
            let run = AssertUnwindSafe(|| process_and_report(one, request, progress));
            // A bug that one session triggers must not cost the others.
            match std::panic::catch_unwind(run) {
                Ok(Ok(processed)) => outcome(one, &processed),
                Ok(Err(error)) if is_disk_error(&error) => {
                    let (session, source) = (one.key.clone(), Box::new(error));
                    return Err(BatchError::Disk { session, source });
                }
                Ok(Err(error)) => SessionOutcome::failed(&one.key, one.relative(&chain(&error))),
                Err(_) => SessionOutcome::failed(
                    &one.key,
                    "evrig itself failed with the message above; please report this bug".into(),
                ),
            }
        }
    };
    write_outcome(root, &outcome)?;
    Ok(outcome)
}

fn process_and_report(
    one: &FoundSession,
    request: &ProcessRequest,
    progress: OnProgress<'_>,
) -> Result<Processed, BatchError> {
    let processed =
        process_session(&one.path, request, &|stage| progress(BatchProgress::Stage(stage)))?;
    let session = Session::open(&one.path)?;
    let path = session.layout().report();
    std::fs::write(&path, pipeline::report(&session)?).map_err(BatchError::io(&path))?;
    Ok(processed)
}

fn outcome(one: &FoundSession, processed: &Processed) -> SessionOutcome {
    let left_out: Vec<LeftOut> = processed
        .skipped()
        .map(|left| LeftOut { stage: left.stage.into(), because: one.relative(&left.because) })
        .collect();
    let losses = processed.losses.iter();
    let mut because: Vec<String> =
        losses.map(|loss| one.relative(&format!("{}: {}", loss.stream, loss.what))).collect();
    let verdict = if processed.n_lost == 0 { OutcomeKind::Ok } else { OutcomeKind::WithLosses };
    if verdict == OutcomeKind::WithLosses && because.is_empty() {
        because.extend(left_out.iter().map(|left| format!("{}: {}", left.stage, left.because)));
    }
    let n_stages = processed.results().count() as u64;
    SessionOutcome {
        verdict,
        because,
        n_stages,
        left_out,
        ..SessionOutcome::failed(&one.key, String::new())
    }
}

fn causes<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |&error| error.source())
}

fn is_disk_error(error: &BatchError) -> bool {
    matches!(error, BatchError::NoRoom { .. })
        || causes(error).any(|cause| cause.downcast_ref().is_some_and(is_disk))
}

/// An error with those of its causes that it does not state itself.
fn chain(error: &BatchError) -> String {
    let mut text = error.to_string();
    for cause in causes(error).skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text += &format!(": {cause}");
        }
    }
    text
}
