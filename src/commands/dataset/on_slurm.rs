//! A dataset on Slurm: submitting, a task, and what stands behind the tasks.

use super::{gather as files, local};
use crate::batch::{self, BatchError, Job, JobState, Outcome, Resources, Slurm, Splits, Verdict};
use crate::cli::{ProcessArgs, SplitByArg};
use crate::commands::{Ending, Output, variants};
use anyhow::Context;
use serde_json::json;
use std::path::Path;

/// Submits a task for each session, and the job that gathers.
pub(super) fn submit(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let root = args.session.as_path();
    let _held = batch::lock_dataset(root)?;
    refuse_if_under_way(root)?;
    let found = batch::walk(root)?;
    let chosen = local::chosen(root, &found, args.batch.only_failed);
    if chosen.is_empty() {
        let value =
            json!({ "schema": "evrig.slurm-job/1", "sessions": [], "arrays": [], "gather": null });
        output.result(&value, "every session has its outcome; nothing was submitted")?;
        return Ok(Ending::Done);
    }
    let sessions: Vec<String> = chosen.iter().map(|one| one.key.clone()).collect();
    let asked = &args.batch.engine;
    let job = Job {
        schema: "evrig.slurm-job/1".into(),
        sessions,
        arrays: Vec::new(),
        gather: None,
        attempt: 1,
        max_attempts: asked.attempts,
        arguments: words(args)?,
        resources: Resources {
            cpus: asked.cpus,
            memory: asked.memory.clone(),
            time_limit: asked.time_limit.clone(),
            max_tasks: asked.max_tasks,
            options: asked.sbatch.clone(),
        },
    };
    let job = send(root, job)?;
    let arrays: Vec<String> = job.arrays.iter().map(|(id, _)| id.to_string()).collect();
    let text = format!(
        "{} sessions submitted as job {}; job {} gathers what they leave\nnext: evrig process {} --status",
        job.sessions.len(),
        arrays.join(", "),
        job.gather.unwrap_or(0),
        root.display()
    );
    output.result(&json!(job), text)?;
    Ok(Ending::Done)
}

/// What every task and the job behind them are given of a command line.
fn words(args: &ProcessArgs) -> anyhow::Result<Vec<String>> {
    let asked = &args.batch;
    let mut words = args.choice.words();
    words.push(format!("--splits={}", asked.splits));
    words.push(format!("--split-seed={}", asked.split_seed));
    if asked.split_by == SplitByArg::Stimulus {
        words.push("--split-by=stimulus".into());
    }
    if let Some(list) = &args.variants {
        words.push(format!("--variants={}", variants::elsewhere(list)?));
    }
    if args.force {
        words.push("--force".into());
    }
    Ok(words)
}

fn send(root: &Path, job: Job) -> anyhow::Result<Job> {
    for session in &job.sessions {
        batch::clear_outcome(root, session)?;
    }
    Ok(Slurm::new(root)?.submit(job)?)
}

/// The session of one task.
pub(super) fn task(number: usize, args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let root = args.session.as_path();
    let job = batch::read_job(root)?.context("nothing was submitted for this dataset")?;
    let key = job.sessions.get(number).with_context(|| {
        format!("task {number}: {} sessions were submitted", job.sessions.len())
    })?;
    let found = batch::walk(root)?;
    let outcome = match found.iter().find(|one| one.key == *key) {
        Some(one) => local::session(root, one, args, output)?,
        None => {
            let gone = Outcome::failed(key, "the session is no longer there".into());
            batch::write_outcome(root, &gone)?;
            gone
        }
    };
    output.result(&json!(outcome), format!("{key}: {}", local::words(&outcome)))?;
    Ok(if outcome.verdict == Verdict::Ok { Ending::Done } else { Ending::WithLosses })
}

/// Behind the tasks: those that were cut off once more, or the files of the dataset.
pub(super) fn gather(
    args: &ProcessArgs,
    splits: &Splits,
    output: &Output,
) -> anyhow::Result<Ending> {
    let root = args.session.as_path();
    let _held = batch::lock_dataset(root)?;
    let job = batch::read_job(root)?.context("nothing was submitted for this dataset")?;
    let states = Slurm::new(root)?.states(&job)?;
    let mut again = Vec::new();
    for session in &job.sessions {
        if batch::read_outcome(root, session).is_some() {
            continue;
        }
        match ended(&job, states.get(session).copied()) {
            Some(because) => batch::write_outcome(root, &Outcome::failed(session, because))?,
            None => again.push(session.clone()),
        }
    }
    if !again.is_empty() {
        let said = format!(
            "{} tasks were cut off and are submitted again: {}",
            again.len(),
            again.join(", ")
        );
        let job = send(root, Job { sessions: again, attempt: job.attempt + 1, ..job })?;
        output.result(&json!(job), said)?;
        return Ok(Ending::Done);
    }
    files::finish(root, args, splits, output)
}

/// Why a task that left no outcome is not tried again; none if it is.
fn ended(job: &Job, state: Option<JobState>) -> Option<String> {
    let logs = "batch/slurm/logs has what it said";
    match state {
        Some(JobState::Cancelled) => Some("its task was cancelled".into()),
        Some(JobState::OutOfTime) => Some(format!(
            "its task ran out of its time of {}; give more with --time-limit",
            job.resources.time_limit
        )),
        Some(JobState::OutOfMemory) => Some(format!(
            "its task ran out of its memory of {}; give more with --memory",
            job.resources.memory
        )),
        _ if job.attempt >= job.max_attempts => Some(format!(
            "its task was cut off, at attempt {} of {}; {logs}",
            job.attempt, job.max_attempts
        )),
        _ => None,
    }
}

/// Refuses to touch a dataset on which Slurm still works.
pub(super) fn refuse_if_under_way(root: &Path) -> anyhow::Result<()> {
    let Some(job) = batch::read_job(root)? else { return Ok(()) };
    let jobs: Vec<String> =
        job.arrays.iter().map(|(id, _)| *id).chain(job.gather).map(|id| id.to_string()).collect();
    let is_under_way = Slurm::new(root)?.is_under_way(&job).unwrap_or(false);
    if is_under_way {
        let whom = format!(
            "Slurm (jobs {}); --status shows them, `scancel {}` ends them",
            jobs.join(", "),
            jobs.join(" ")
        );
        return Err(BatchError::Busy { path: root.to_owned(), whom }.into());
    }
    Ok(())
}
