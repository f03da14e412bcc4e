//! `demo`: the main job on a machine without hardware, from the recording to the report.

use super::{Ending, Output, run};
use crate::cli::{Cli, DemoArgs};
use anyhow::Context;
use clap::Parser;
use evrig_session::SessionLayout;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

pub(super) fn demo(args: &DemoArgs, output: &Output) -> anyhow::Result<Ending> {
    let out = args.out.clone().unwrap_or_else(free_directory);
    let session = out.display().to_string();
    output.say("recording on the simulated rig: the same engine, wires and files as on a real one");
    let mut record = vec!["record", "sim", &args.trajectory, "--out", &session];
    let (world, seed) = (args.world.as_ref().map(|path| path.display().to_string()), args.seed);
    let seed = seed.to_string();
    record.extend(["--seed", &seed]);
    if let Some(world) = &world {
        record.extend(["--world", world]);
    }
    let (recorded, recording) = verb(&record, output)?;
    if !matches!(recorded, Ending::Done | Ending::WithLosses) {
        output.result(&json!({ "schema": "evrig.demo/1", "recording": recording }), &session)?;
        return Ok(recorded);
    }
    output.say("processing it as any recorded session");
    let (_, processed) = verb(&["process", &session], output)?;
    verb(&["report", &session], output)?;
    let report = SessionLayout::new(&out).report();
    let mut text = findings(&recording, &processed)?;
    write!(text, "report: {}", std::path::absolute(&report).unwrap_or(report).display())?;
    let value = json!({
        "schema": "evrig.demo/1", "session": out, "report": SessionLayout::new(&out).report(),
        "recording": recording, "process": processed,
    });
    output.result(&value, text)?;
    Ok(recorded)
}

/// Runs another verb as a user would, and keeps its result.
fn verb(arguments: &[&str], output: &Output) -> anyhow::Result<(Ending, Value)> {
    let name = arguments.first().copied().unwrap_or_default();
    let cli = Cli::try_parse_from(std::iter::once("evrig").chain(arguments.iter().copied()))?;
    let (keeping, kept) = output.keeping();
    let ending = run(cli.command, &keeping).with_context(|| format!("`evrig {name}` failed"))?;
    let value = kept.borrow_mut().pop().unwrap_or(Value::Null);
    Ok((ending, value))
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

/// What came out, in a few lines.
fn findings(recording: &Value, processed: &Value) -> anyhow::Result<String> {
    let mut text = String::new();
    let streams = recording["streams"].as_array().map(Vec::as_slice).unwrap_or_default();
    let counts = streams.iter().filter_map(|stream| {
        let kind = stream["kind"].as_str().filter(|kind| ["events", "frames"].contains(kind))?;
        Some(format!("{} {} {kind}", stream["count"].as_u64()?, stream["name"].as_str()?))
    });
    writeln!(text, "recorded: {}", counts.collect::<Vec<_>>().join(", "))?;
    let mut comparisons = Vec::new();
    of_schema(processed, "evrig.comparison/", &mut comparisons);
    for comparison in comparisons {
        let name = comparison["simulated"].as_str().unwrap_or("simulated");
        let [simulated, real] =
            ["n_simulated", "n_real"].map(|key| comparison[key].as_f64().unwrap_or(f64::NAN));
        writeln!(text, "{name}: {:.2} generated events for each real one", simulated / real)?;
    }
    let mut diagnoses = Vec::new();
    of_schema(processed, "evrig.diagnosis/", &mut diagnoses);
    for diagnosis in diagnoses {
        let verdict = diagnosis["verdict"].as_str().unwrap_or("none").replace('_', " ");
        writeln!(text, "diagnosis: {verdict}")?;
        let effects = diagnosis["effects"].as_array().map(Vec::as_slice).unwrap_or_default();
        for effect in effects.iter().filter_map(|effect| effect["says"].as_str()) {
            writeln!(text, "  {effect}")?;
        }
    }
    Ok(text)
}

/// Every value of a schema within a value.
fn of_schema<'a>(value: &'a Value, schema: &str, found: &mut Vec<&'a Value>) {
    if value["schema"].as_str().is_some_and(|own| own.starts_with(schema)) {
        found.push(value);
        return;
    }
    match value {
        Value::Array(values) => values.iter().for_each(|value| of_schema(value, schema, found)),
        Value::Object(fields) => fields.values().for_each(|value| of_schema(value, schema, found)),
        _ => {}
    }
}
