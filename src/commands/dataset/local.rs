//! The sessions of a dataset one after another, whatever each of them is like.

use super::gather;
use crate::batch::{self, BatchError, Found, LeftOut, Outcome, Splits, Verdict};
use crate::cli::ProcessArgs;
use crate::commands::process::{self, Processed};
use crate::commands::{Ending, Output};
use crate::pipeline;
use anyhow::Context;
use evrig_session::Session;
use serde_json::Value;
use std::panic::AssertUnwindSafe;
use std::path::Path;

pub(super) fn run(args: &ProcessArgs, splits: &Splits, output: &Output) -> anyhow::Result<Ending> {
    let root = args.session.as_path();
    let _held = batch::lock_dataset(root)?;
    super::on_slurm::refuse_if_under_way(root)?;
    let found = batch::walk(root)?;
    let chosen = chosen(root, &found, args.batch.only_failed);
    let bar = output.progress("sessions", chosen.len() as u64);
    for one in &chosen {
        output.say(format!("{} ...", one.key));
        let outcome = session(root, one, args, output)?;
        output.say(format!("{}: {}", one.key, words(&outcome)));
        bar.inc(1);
    }
    bar.finish_and_clear();
    gather::finish(root, args, splits, output)
}

/// The sessions to process: all, or those without a good outcome.
pub(super) fn chosen<'a>(root: &Path, found: &'a [Found], only_failed: bool) -> Vec<&'a Found> {
    let is_unwell = |one: &&Found| {
        batch::read_outcome(root, &one.key).is_none_or(|o| o.verdict == Verdict::Failed)
    };
    found.iter().filter(|one| !only_failed || is_unwell(one)).collect()
}

/// Processes one session and keeps what became of it.
///
/// # Errors
/// When the disk is at fault, so that no other session would fare better.
pub(super) fn session(
    root: &Path,
    one: &Found,
    args: &ProcessArgs,
    output: &Output,
) -> anyhow::Result<Outcome> {
    batch::clear_outcome(root, &one.key)?;
    let outcome = match &one.session {
        Err(because) => Outcome::failed(&one.key, because.clone()),
        Ok(_) => {
            let ran = AssertUnwindSafe(|| whole(one, args, output));
            // A fault of ours in one session must not cost the night's other sessions.
            match std::panic::catch_unwind(ran) {
                Ok(Ok(processed)) => outcome(one, &processed),
                Ok(Err(error)) if concerns_all(&error) => {
                    let said = "no session would fare better, so the dataset was left there";
                    return Err(error.context(format!("{}: {said}", one.key)));
                }
                Ok(Err(error)) => Outcome::failed(&one.key, one.told(&chain(&error))),
                Err(_) => Outcome::failed(
                    &one.key,
                    "evrig itself failed, as said above; this is a fault to report".into(),
                ),
            }
        }
    };
    batch::write_outcome(root, &outcome)?;
    Ok(outcome)
}

/// Every stage, and the report.
fn whole(one: &Found, args: &ProcessArgs, output: &Output) -> anyhow::Result<Processed> {
    let processed = process::session(&one.path, args, output)?;
    let session = Session::open(&one.path)?;
    let path = session.layout().report();
    std::fs::write(&path, pipeline::report(&session)?)
        .with_context(|| path.display().to_string())?;
    Ok(processed)
}

fn outcome(one: &Found, processed: &Processed) -> Outcome {
    let value = &processed.value;
    let list = |key: &str| value[key].as_array().map(Vec::as_slice).unwrap_or_default();
    let text = |value: &Value| one.told(value.as_str().unwrap_or_default());
    let left_out: Vec<LeftOut> = list("left_out")
        .iter()
        .map(|left| LeftOut { stage: text(&left["stage"]), because: text(&left["because"]) })
        .collect();
    let losses = list("losses").iter();
    let mut because: Vec<String> =
        losses.map(|loss| format!("{}: {}", text(&loss["stream"]), text(&loss["what"]))).collect();
    let verdict = if processed.n_lost == 0 { Verdict::Ok } else { Verdict::WithLosses };
    if verdict == Verdict::WithLosses && because.is_empty() {
        because.extend(left_out.iter().map(|left| format!("{}: {}", left.stage, left.because)));
    }
    let n_stages = list("stages").len() as u64;
    Outcome { verdict, because, n_stages, left_out, ..Outcome::failed(&one.key, String::new()) }
}

/// Whether an error is the disk's rather than the session's.
fn concerns_all(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let of_disk = cause.downcast_ref::<std::io::Error>().is_some_and(batch::is_disk);
        of_disk || matches!(cause.downcast_ref::<BatchError>(), Some(BatchError::NoRoom { .. }))
    })
}

fn chain(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text += &format!(": {cause}");
        }
    }
    text
}

/// An outcome in one line.
pub(super) fn words(outcome: &Outcome) -> String {
    if outcome.because.is_empty() {
        format!("{} ({} stages)", outcome.verdict, outcome.n_stages)
    } else {
        format!("{}: {}", outcome.verdict, outcome.because.join("; "))
    }
}
