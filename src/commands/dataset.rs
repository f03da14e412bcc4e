//! The verbs over a dataset: `process`, `compare` and `report` of a folder of sessions.

mod comparison;
mod gather;
mod local;
mod on_slurm;
mod status;

use super::{Ending, Output, WrongUse};
use crate::batch::{self, SplitBy, Splits};
use crate::cli::{Engine, ProcessArgs, ReportArgs, SplitByArg};
use anyhow::Context;
use serde_json::json;

pub(super) use comparison::compare;

/// `evrig process DATASET`.
pub(super) fn process(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let splits = Splits::parse(&args.batch.splits).map_err(|e| WrongUse(e.to_string()))?;
    let by = match args.batch.split_by {
        SplitByArg::Recording => SplitBy::Recording,
        SplitByArg::Stimulus => SplitBy::Stimulus,
    };
    let splits = splits.drawn(by, args.batch.split_seed);
    if args.batch.status {
        return status::status(args, output);
    }
    if let Some(task) = args.batch.task {
        return on_slurm::task(task, args, output);
    }
    if args.batch.gather {
        return on_slurm::gather(args, &splits, output);
    }
    match args.batch.engine.engine {
        Engine::Local => local::run(args, &splits, output),
        Engine::Slurm => on_slurm::submit(args, output),
    }
}

/// `evrig report DATASET`.
pub(super) fn report(args: &ReportArgs, output: &Output) -> anyhow::Result<Ending> {
    let root = &args.session;
    let found = batch::walk(root)?;
    // A dataset that was processed keeps the splits that it was processed with.
    let splits = gather::splits_of(root)?;
    let index = batch::index(root, &found, &splits);
    let all: Vec<_> = found.iter().collect();
    let aggregate = batch::aggregate(&index.name, &all, None, 0);
    let html = batch::dataset_page(root, &index, &aggregate).to_html()?;
    let path = args.out.clone().unwrap_or_else(|| root.join("report.html"));
    std::fs::write(&path, &html)
        .with_context(|| format!("cannot write the report to {}", path.display()))?;
    let value = json!({
        "schema": "evrig.report/1", "dataset": index.name, "path": path, "bytes": html.len(),
    });
    output.result(&value, path.display())?;
    Ok(Ending::Done)
}
