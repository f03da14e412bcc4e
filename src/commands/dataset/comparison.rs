//! `evrig compare DATASET`: the measures by generator variant over the sessions.

use crate::batch::{self, Aggregate, Found, SplitBy};
use crate::cli::{BatchArgs, CompareArgs, Engine, ModelArgs, ProcessArgs, SplitByArg};
use crate::commands::{Ending, Output, WrongUse, compare as verb, variants};
use crate::pipeline::{self, CompareRequest, PipelineError};
use evrig_report::number::quantity;
use evrig_session::{Session, StreamName};
use serde_json::json;
use std::path::Path;

pub(in crate::commands) fn compare(args: &CompareArgs, output: &Output) -> anyhow::Result<Ending> {
    let root = args.session.as_path();
    if args.engine.engine == Engine::Slurm {
        return super::on_slurm::submit(&whole(args)?, output);
    }
    let _held = batch::lock_dataset(root)?;
    super::on_slurm::refuse_if_under_way(root)?;
    let found = batch::walk(root)?;
    let splits = super::gather::splits_of(root)?;
    let index = batch::index(root, &found, &splits);
    let chosen = of_rig(&found, &index, args)?;
    let mut lost = Vec::new();
    let bar = output.progress("sessions", chosen.len() as u64);
    for one in &chosen {
        if let Ok(session) = &one.session
            && let Err(error) = one_session(session, args, output)
        {
            if error.is::<WrongUse>() {
                return Err(error);
            }
            lost.push(format!("{}: {}", one.key, one.told(&format!("{error:#}"))));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut aggregate = batch::aggregate(&index.name, &chosen, args.rig.as_deref(), args.seed);
    if args.rig.is_none() {
        index.warnings.iter().for_each(|warning| output.warn(warning));
    }
    aggregate.left_out.extend(lost);
    write(root, &aggregate)?;
    for because in &aggregate.left_out {
        output.warn(format!("left out: {because}"));
    }
    let text = format!("{}\n{}", table(&aggregate), root.join("comparison.html").display());
    output.result(&json!(aggregate), text)?;
    Ok(if aggregate.left_out.is_empty() { Ending::Done } else { Ending::WithLosses })
}

/// A run over the dataset that also makes the variants: what stands beside a comparison on Slurm, where
/// a task brings its session up to date first.
fn whole(args: &CompareArgs) -> anyhow::Result<ProcessArgs> {
    if args.variants.is_none() || args.rig.is_some() || args.real != "real" {
        let what =
            "on Slurm a dataset is compared with --variants LIST, and without --rig and --real";
        return Err(WrongUse(what.into()).into());
    }
    let splits = super::gather::splits_of(&args.session)?;
    let shares = splits.shares().iter().map(|share| format!("{}={}", share.name, share.share));
    Ok(ProcessArgs {
        session: args.session.clone(),
        choice: ModelArgs { seed: args.seed, ..ModelArgs::default() },
        variants: args.variants.clone(),
        force: args.force,
        batch: BatchArgs {
            engine: args.engine.clone(),
            status: false,
            only_failed: false,
            splits: shares.collect::<Vec<_>>().join(","),
            split_by: match splits.by() {
                SplitBy::Recording => SplitByArg::Recording,
                SplitBy::Stimulus => SplitByArg::Stimulus,
            },
            split_seed: splits.seed(),
            task: None,
            gather: false,
        },
    })
}

/// The sessions of the rig that was asked for.
fn of_rig<'a>(
    found: &'a [Found],
    index: &batch::Index,
    args: &CompareArgs,
) -> anyhow::Result<Vec<&'a Found>> {
    let Some(wanted) = &args.rig else { return Ok(found.iter().collect()) };
    let has = |session: &batch::IndexedSession| {
        session.rig.as_ref().is_some_and(|rig| rig.starts_with(wanted.as_str()))
    };
    let chosen: Vec<&Found> = found
        .iter()
        .zip(&index.sessions)
        .filter(|(_, session)| has(session))
        .map(|(one, _)| one)
        .collect();
    if chosen.is_empty() {
        let known: Vec<&str> = index.rigs.iter().map(|rig| rig.id.as_str()).collect();
        let what = format!("no session is of a rig `{wanted}`; there are: {}", known.join("; "));
        return Err(WrongUse(what).into());
    }
    Ok(chosen)
}

fn one_session(session: &Session, args: &CompareArgs, output: &Output) -> anyhow::Result<()> {
    let _held = batch::lock_session(session)?;
    if let Some(list) = &args.variants {
        let (keeping, _) = output.keeping();
        let choice = ModelArgs { seed: args.seed, ..ModelArgs::default() };
        variants::run(session, list, &choice, args.force, &keeping)?;
    }
    let streams = match &args.stream {
        Some(name) => vec![StreamName::new(name).map_err(|error| WrongUse(error.to_string()))?],
        None => verb::simulated(session, &args.real),
    };
    for simulated in streams {
        let (real, seed) = (args.real.clone(), args.seed);
        let request = CompareRequest { real, simulated, seed, force: args.force };
        match pipeline::compare(session, &request) {
            // Streams on other grids are compared once they are cut; `process` says so.
            Ok(_) | Err(PipelineError::Missing { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Writes the comparison's JSON, tables and page.
pub(super) fn write(root: &Path, aggregate: &Aggregate) -> anyhow::Result<()> {
    aggregate.write(root)?;
    let path = root.join("comparison.html");
    let html = batch::comparison_page(aggregate).to_html()?;
    std::fs::write(&path, html).map_err(batch::BatchError::io(&path))?;
    Ok(())
}

/// A line a variant.
fn table(aggregate: &Aggregate) -> String {
    let mut lines = vec![vec!["variant".to_owned(), "sessions".to_owned()]];
    let names = aggregate.variants.first().map(|variant| variant.cells.as_slice());
    lines[0].extend(names.unwrap_or_default().iter().map(|cell| cell.measure.clone()));
    for variant in &aggregate.variants {
        let mut line = vec![variant.name.clone(), variant.n_sessions.to_string()];
        line.extend(variant.cells.iter().map(|cell| quantity(&cell.mean).to_string()));
        lines.push(line);
    }
    let n_columns = lines[0].len();
    let width = |column: usize| {
        lines.iter().filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max()
    };
    let widths: Vec<usize> = (0..n_columns).map(|column| width(column).unwrap_or(0)).collect();
    let set = |line: &Vec<String>| {
        let cells = line.iter().zip(&widths).map(|(cell, &width)| format!("{cell:<width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    lines.iter().map(set).collect::<Vec<_>>().join("\n")
}
