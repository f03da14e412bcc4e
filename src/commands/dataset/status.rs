//! `evrig process DATASET --status`: what became of each session, and what Slurm is doing.

use super::local;
use crate::batch::{self, Slurm};
use crate::cli::ProcessArgs;
use crate::commands::{Ending, Output};
use serde_json::json;
use std::collections::BTreeMap;

pub(super) fn status(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let root = args.session.as_path();
    let found = batch::walk(root)?;
    let job = batch::read_job(root)?;
    // A dataset that was copied from its cluster has a record of jobs, and no Slurm to ask.
    let asked = job.as_ref().map(|job| Slurm::new(root).and_then(|slurm| slurm.states(job)));
    let (states, silent) = match asked {
        Some(Ok(states)) => (states, None),
        Some(Err(error)) => (BTreeMap::new(), Some(error.to_string())),
        None => (BTreeMap::new(), None),
    };
    let mut rows = Vec::new();
    let mut lines = Vec::new();
    let mut n_done = 0;
    for one in &found {
        let outcome = batch::read_outcome(root, &one.key);
        let state = states.get(&one.key);
        let words = match (&outcome, state) {
            (Some(outcome), _) => local::words(outcome),
            (None, Some(state)) => state.to_string(),
            (None, None) => "not processed".to_owned(),
        };
        n_done += usize::from(outcome.is_some());
        lines.push(format!("{}  {words}", one.key));
        rows.push(json!({
            "session": one.key,
            "verdict": outcome.as_ref().map(|outcome| outcome.verdict),
            "because": outcome.as_ref().map(|outcome| &outcome.because),
            "state": state,
        }));
    }
    if let Some(job) = &job {
        let arrays: Vec<String> = job.arrays.iter().map(|(id, _)| id.to_string()).collect();
        lines.push(format!(
            "Slurm: job {}, gathered by job {}, attempt {} of {}{}",
            arrays.join(", "),
            job.gather.map_or("none".into(), |id| id.to_string()),
            job.attempt,
            job.max_attempts,
            silent.as_ref().map_or(String::new(), |error| format!("; {error}"))
        ));
    }
    lines.push(format!("{n_done} of {} have their outcome", found.len()));
    let value = json!({
        "schema": "evrig.dataset-status/1", "sessions": rows, "job": job, "slurm_error": silent,
    });
    output.result(&value, lines.join("\n"))?;
    Ok(Ending::Done)
}
