//! `process`, `compare` and `report` of a dataset: a folder of sessions.

mod text;

use super::progress::ProgressDisplay;
use super::{Ending, Output, WrongUse};
use crate::batch::{
    self, Aggregate, BatchError, BatchProgress, DatasetCompareRequest, Gathered, Index,
    OutcomeKind, PaperTableRequest, Resources, SlurmJob, SplitBy, Splits,
};
use crate::cli::{BatchArgs, CompareArgs, Engine, EngineArgs, ReportArgs, SplitByArg};
use crate::pipeline::{ModelChoice, ProcessRequest, VariantList};
use anyhow::Context;
use evrig_session::StreamName;
use serde_json::json;
use std::path::{Path, PathBuf};

/// `evrig process DATASET`.
pub(super) fn process(
    root: &Path,
    request: &ProcessRequest,
    args: &BatchArgs,
    output: &Output,
) -> anyhow::Result<Ending> {
    let splits = Splits::parse(&args.splits).map_err(|error| WrongUse(error.to_string()))?;
    let by = match args.split_by {
        SplitByArg::Recording => SplitBy::Recording,
        SplitByArg::Stimulus => SplitBy::Stimulus,
    };
    let splits = splits.drawn(by, args.split_seed);
    if args.status {
        return status(root, output);
    }
    let display = ProgressDisplay::new(output);
    let progress = |progress: BatchProgress<'_>| display.show_batch(progress);
    if let Some(number) = args.task {
        let outcome = batch::run_task(root, number, request, &progress)?;
        output.result(&outcome, format_args!("{}: {}", outcome.session, outcome.summary()))?;
        let is_ok = outcome.verdict == OutcomeKind::Ok;
        return Ok(if is_ok { Ending::Done } else { Ending::WithLosses });
    }
    if args.gather {
        return match batch::gather(root, &splits, request.choice.seed)? {
            Gathered::Complete(made) => results(root, &made, output),
            Gathered::Resubmitted(job) => {
                let (n, sessions) = (job.sessions.len(), job.sessions.join(", "));
                let text = format!("{n} tasks were cut off and are submitted again: {sessions}");
                output.result(&job, text)?;
                Ok(Ending::Done)
            }
        };
    }
    match args.engine.engine {
        Engine::Local => {
            let made = batch::process_dataset(root, request, &splits, args.only_failed, &progress)?;
            drop(display);
            results(root, &made, output)
        }
        Engine::Slurm => submit(root, request, &splits, args.only_failed, &args.engine, output),
    }
}

fn results(
    root: &Path,
    (index, aggregate): &(Index, Aggregate),
    output: &Output,
) -> anyhow::Result<Ending> {
    let value = json!({
        "schema": "evrig.process-dataset/1",
        "dataset": index.name,
        "n_ok": index.n_with(Some(OutcomeKind::Ok)),
        "n_with_losses": index.n_with(Some(OutcomeKind::WithLosses)),
        "n_failed": index.n_with(Some(OutcomeKind::Failed)),
        "n_not_processed": index.n_with(None),
        "warnings": index.warnings,
        "sessions": index.sessions,
        "variants": aggregate.variants,
    });
    index.warnings.iter().for_each(|warning| output.warn(warning));
    let report = root.join("report.html");
    output.result(&value, format_args!("{}report: {}", text::sessions(index), report.display()))?;
    let is_whole = index.n_with(Some(OutcomeKind::Ok)) == index.sessions.len();
    Ok(if is_whole { Ending::Done } else { Ending::WithLosses })
}

fn submit(
    root: &Path,
    request: &ProcessRequest,
    splits: &Splits,
    only_failed: bool,
    args: &EngineArgs,
    output: &Output,
) -> anyhow::Result<Ending> {
    let resources = Resources {
        cpus: args.cpus,
        memory: args.memory.clone(),
        time_limit: args.time_limit.clone(),
        max_tasks: args.max_tasks,
        options: args.sbatch.clone(),
    };
    match batch::submit(root, request, splits, only_failed, resources, args.attempts)? {
        None => {
            let value = json!({
                "schema": "evrig.slurm-job/1", "sessions": [], "arrays": [], "gather": null,
            });
            output.result(&value, "every session has its outcome; nothing was submitted")?;
        }
        Some(job) => {
            let text = format!(
                "{} sessions submitted as job {}; job {} gathers their outcomes\n\
                 next: evrig process {} --status",
                job.sessions.len(),
                arrays(&job),
                job.gather.unwrap_or(0),
                root.display()
            );
            output.result(&job, text)?;
        }
    }
    Ok(Ending::Done)
}

fn arrays(job: &SlurmJob) -> String {
    let arrays: Vec<String> = job.arrays.iter().map(|(id, _)| id.to_string()).collect();
    arrays.join(", ")
}

/// `evrig process DATASET --status`.
fn status(root: &Path, output: &Output) -> anyhow::Result<Ending> {
    let batch::DatasetStatus { sessions, job, slurm_error } = batch::status(root)?;
    let (mut rows, mut lines) = (Vec::new(), Vec::new());
    for (session, outcome, state) in &sessions {
        let text = match (outcome, state) {
            (Some(outcome), _) => outcome.summary(),
            (None, Some(state)) => state.to_string(),
            (None, None) => "not processed".to_owned(),
        };
        lines.push(format!("{session}  {text}"));
        rows.push(json!({
            "session": session,
            "verdict": outcome.as_ref().map(|outcome| outcome.verdict),
            "because": outcome.as_ref().map(|outcome| &outcome.because),
            "state": state,
        }));
    }
    if let Some(job) = &job {
        lines.push(format!(
            "Slurm: job {}, gathered by job {}, attempt {} of {}{}",
            arrays(job),
            job.gather.map_or("none".into(), |id| id.to_string()),
            job.attempt,
            job.max_attempts,
            slurm_error.as_ref().map_or(String::new(), |error| format!("; {error}"))
        ));
    }
    let n_done = sessions.iter().filter(|(_, outcome, _)| outcome.is_some()).count();
    lines.push(format!("{n_done} of {} have their outcome", sessions.len()));
    let value = json!({
        "schema": "evrig.dataset-status/1", "sessions": rows, "job": job,
        "slurm_error": slurm_error,
    });
    output.result(&value, lines.join("\n"))?;
    Ok(Ending::Done)
}

/// `evrig report DATASET`.
pub(super) fn report(args: &ReportArgs, output: &Output) -> anyhow::Result<Ending> {
    let (index, html) = batch::dataset_report(&args.session)?;
    let path = args.out.clone().unwrap_or_else(|| args.session.join("report.html"));
    std::fs::write(&path, &html)
        .with_context(|| format!("cannot write the report to {}", path.display()))?;
    let value = json!({
        "schema": "evrig.report/1", "dataset": index.name, "path": path, "bytes": html.len(),
    });
    output.result(&value, path.display())?;
    Ok(Ending::Done)
}

/// `evrig compare DATASET`.
pub(super) fn compare(args: &CompareArgs, output: &Output) -> anyhow::Result<Ending> {
    let root = args.session.as_path();
    let variants = args.variants.as_deref().map(VariantList::read).transpose()?;
    if args.engine.engine == Engine::Slurm {
        let is_other = args.rig.is_some() || args.real != "real" || args.table.is_some();
        if variants.is_none() || is_other {
            let what = "on Slurm a dataset is compared with --variants LIST, and without --rig, \
                        --real and --table";
            return Err(WrongUse(what.into()).into());
        }
        // A task also brings its session's other stages up to date.
        let choice = ModelChoice::seeded(args.seed);
        let request = ProcessRequest { choice, variants, n_pixels: None, force: args.force };
        let splits = batch::read_splits(root)?;
        return submit(root, &request, &splits, false, &args.engine, output);
    }
    let stream = args.stream.as_deref().map(StreamName::new).transpose();
    let request = DatasetCompareRequest {
        stream: stream.map_err(|error| WrongUse(error.to_string()))?,
        real: args.real.clone(),
        variants,
        rig: args.rig.clone(),
        seed: args.seed,
        force: args.force,
    };
    let display = ProgressDisplay::new(output);
    let (index, aggregate) =
        batch::compare_dataset(root, &request, &|progress| display.show_batch(progress))?;
    drop(display);
    if args.rig.is_none() {
        index.warnings.iter().for_each(|warning| output.warn(warning));
    }
    for because in &aggregate.left_out {
        output.warn(format_args!("left out: {because}"));
    }
    let page = root.join("comparison.html");
    let mut text = format!("{}\n{}", text::comparison(&aggregate), page.display());
    for path in paper_table(args, &aggregate)? {
        text += &format!("\n{}", path.display());
    }
    output.result(&aggregate, text)?;
    Ok(if aggregate.left_out.is_empty() { Ending::Done } else { Ending::WithLosses })
}

/// Writes the table of `--table`; gives its files.
pub(super) fn paper_table(
    args: &CompareArgs,
    aggregate: &Aggregate,
) -> Result<Vec<PathBuf>, BatchError> {
    let Some(out) = args.table.clone() else { return Ok(Vec::new()) };
    let (measures, has_sessions) = (args.measures.clone(), args.each_session);
    let request = PaperTableRequest { out, measures, has_sessions };
    Ok(batch::write_paper_table(aggregate, &request)?.to_vec())
}
