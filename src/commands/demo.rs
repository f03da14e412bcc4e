//! `demo`: from the recording to the report on a machine without hardware.

use super::progress::ProgressDisplay;
use super::record::{self, RecordedTake};
use super::{Ending, Output, process};
use crate::batch;
use crate::cli::DemoArgs;
use crate::pipeline::{self, ProcessRequest, Processed, StageResult};
use anyhow::Context;
use evrig_session::{Session, StreamKind};
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

pub(super) fn demo(args: &DemoArgs, output: &Output) -> anyhow::Result<Ending> {
    let out = args.out.clone().unwrap_or_else(free_directory);
    output.say("recording on the simulated rig: the same engine, wires and files as on a real one");
    let take = record::simulated(&args.trajectory, args.world.as_deref(), args.seed, &out, output)
        .context("the recording failed")?;
    let Some(take) = take else { return Ok(Ending::Aborted) };
    if !matches!(take.ending, Ending::Done | Ending::WithLosses) {
        let value = json!({ "schema": "evrig.demo/1", "recording": take.value });
        output.result(&value, out.display())?;
        return Ok(take.ending);
    }
    output.say("processing it as any recorded session");
    let display = ProgressDisplay::new(output);
    let request = ProcessRequest::default();
    let processed = batch::process_session(&out, &request, &|progress| display.show(progress))
        .context("the processing failed")?;
    drop(display);
    let session = Session::open(&out)?;
    let report = session.layout().report();
    std::fs::write(&report, pipeline::report(&session)?)
        .with_context(|| format!("cannot write the report to {}", report.display()))?;
    let mut text = findings(&take, &processed)?;
    write!(text, "report: {}", std::path::absolute(&report).unwrap_or(report.clone()).display())?;
    let value = json!({
        "schema": "evrig.demo/1", "session": out, "report": report,
        "recording": take.value, "process": process::value(&processed)?,
    });
    output.result(&value, text)?;
    Ok(take.ending)
}

/// `evrig-demo` here, or the first number behind it that is free.
fn free_directory() -> PathBuf {
    let is_free = |path: &Path| {
        std::fs::read_dir(path).map_or(!path.exists(), |mut entries| entries.next().is_none())
    };
    let names = (1_u32..).map(|n| match n {
        1 => PathBuf::from("evrig-demo"),
        n => PathBuf::from(format!("evrig-demo-{n}")),
    });
    names.into_iter().find(|path| is_free(path)).unwrap_or_default()
}

/// Streams, event ratios and the diagnosis in a few lines.
fn findings(take: &RecordedTake, processed: &Processed) -> anyhow::Result<String> {
    let mut text = String::new();
    let streams = take.manifest.streams.iter();
    let shown = streams.filter(|s| matches!(s.kind, StreamKind::Events | StreamKind::Frames));
    let counts: Vec<String> =
        shown.map(|stream| format!("{} {} {}", stream.count, stream.name, stream.kind)).collect();
    writeln!(text, "recorded: {}", counts.join(", "))?;
    for result in processed.results() {
        match result {
            StageResult::Compare(request, comparison, _) => {
                let ratio = comparison.n_simulated as f64 / comparison.n_real as f64;
                writeln!(
                    text,
                    "{}: {ratio:.2} generated events per real event",
                    request.simulated
                )?;
            }
            StageResult::Diagnose(diagnosis) => {
                let verdict = serde_json::to_value(diagnosis.verdict)?;
                let verdict = verdict.as_str().unwrap_or("none").replace('_', " ");
                writeln!(text, "diagnosis: {verdict}")?;
                for effect in &diagnosis.effects {
                    writeln!(text, "  {}", effect.description)?;
                }
            }
            _ => {}
        }
    }
    Ok(text)
}
