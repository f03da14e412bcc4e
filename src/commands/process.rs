//! `evrig process`: every stage for which there is input, and what was left out and why.

mod explain;
mod own_light;
mod steps;
mod target;

pub(super) use target::cut_alike;

use super::{Ending, Output, WrongUse};
use crate::cli::{Engine, ProcessArgs};
use evrig_session::Session;
use serde_json::{Value, json};
use std::path::Path;
use steps::Steps;

/// A session that was processed.
pub(super) struct Processed {
    /// The result as consumers of `--json` get it.
    pub(super) value: Value,
    /// The same for people.
    pub(super) text: String,
    /// Losses of the recording, and stages that had their inputs and gave nothing.
    pub(super) n_lost: usize,
}

pub(super) fn run(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    if let Some(list) = &args.variants {
        // A list that cannot be read is said now, and not of every session.
        super::variants::elsewhere(list)?;
    }
    if crate::batch::is_dataset(&args.session) {
        return super::dataset::process(args, output);
    }
    let batch = &args.batch;
    if batch.engine.engine == Engine::Slurm || batch.status || batch.gather || batch.task.is_some()
    {
        let what = format!(
            "{} is a session; --engine slurm and --status take a dataset, a folder of sessions",
            args.session.display()
        );
        return Err(WrongUse(what).into());
    }
    let processed = session(&args.session, args, output)?;
    let next = format!("next: evrig report {}", args.session.display());
    output.result(&processed.value, processed.text + &next)?;
    Ok(if processed.n_lost == 0 { Ending::Done } else { Ending::WithLosses })
}

/// Every stage of one session.
pub(super) fn session(
    root: &Path,
    args: &ProcessArgs,
    output: &Output,
) -> anyhow::Result<Processed> {
    let session = Session::open(root)?;
    let _held = crate::batch::lock_session(&session)?;
    let mut all = Steps::default();
    all.append(target::align(&session, args, output)?);
    all.append(target::generate_from_scene(&session, args, output)?);
    all.append(own_light::calibrate_and_generate(&session, args, output)?);
    all.append(target::generate_from_pi(&session, args, output)?);
    all.append(target::filter_all(&session, args)?);
    all.append(explain::variants(&session, args, output));
    all.append(explain::compare_all(&session, args)?);
    all.append(explain::diagnose(&session, args, output));
    let value = json!({
        "schema": "evrig.process/1",
        "session": session.manifest().name,
        "stages": all.stages,
        "left_out": all.left_out,
        "losses": session.manifest().losses,
    });
    let n_lost = all.n_lost + session.manifest().losses.len();
    Ok(Processed { value, text: all.text, n_lost })
}
