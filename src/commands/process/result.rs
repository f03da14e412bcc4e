//! The results of all stages for people and as JSON.

use crate::commands::{calibrate, compare, diagnose, filter, generate, scene, sync, track};
use crate::pipeline::{Freshness, ProcessStep, Processed, StageResult};
use serde_json::{Value, json};

/// The result as consumers of `--json` get it.
pub(in crate::commands) fn value(processed: &Processed) -> anyhow::Result<Value> {
    let stages: anyhow::Result<Vec<Value>> = processed
        .results()
        .map(|result| Ok(json!({ "stage": result.stage(), "result": stage_value(result)? })))
        .collect();
    let left_out: Vec<Value> = processed
        .skipped()
        .map(|left| json!({ "stage": left.stage, "because": left.because }))
        .collect();
    Ok(json!({
        "schema": "evrig.process/1",
        "session": processed.session,
        "stages": stages?,
        "left_out": left_out,
        "losses": processed.losses,
    }))
}

fn stage_value(result: &StageResult) -> anyhow::Result<Value> {
    Ok(match result {
        StageResult::Sync(synced) => sync::value(synced),
        StageResult::Track(request, tracked) => track::value(request, tracked),
        StageResult::Scene(made) => scene::value(made),
        StageResult::Calibrate(request, calibration, freshness) => {
            calibrate::value(request, calibration, *freshness)?
        }
        StageResult::Generate(request, made) => generate::value(request, made),
        StageResult::Filter(request, filtered) => filter::value(request, filtered),
        StageResult::Variants(results) => generate::variants_value(results),
        StageResult::Compare(request, comparison, freshness) => {
            compare::value(request, comparison, *freshness)?
        }
        StageResult::Diagnose(diagnosis) => serde_json::to_value(diagnosis)?,
    })
}

/// The result for people: a paragraph per stage, each line ended.
pub(super) fn text(processed: &Processed) -> String {
    let line = |step: &ProcessStep| match step {
        ProcessStep::Done(result) => {
            let text = stage_text(result).replace('\n', "\n          ");
            format!("{:<9} {text}\n", result.stage())
        }
        ProcessStep::Skipped(left) => format!("{:<9} left out: {}\n", left.stage, left.because),
    };
    processed.steps.iter().map(line).collect()
}

fn stage_text(result: &StageResult) -> String {
    match result {
        StageResult::Sync(synced) => sync::text(synced),
        StageResult::Track(request, tracked) => track::text(request, tracked),
        StageResult::Scene(made) => scene::text(made),
        StageResult::Calibrate(_, calibration, freshness) => {
            calibrate::line(calibration, *freshness)
        }
        StageResult::Generate(request, made) => generate::text(request, made),
        StageResult::Filter(request, filtered) => filter::text(request, filtered),
        StageResult::Variants(results) => {
            format!("{}: {} streams", results.list, results.variants.len())
        }
        StageResult::Compare(request, comparison, freshness) => {
            let mark = if *freshness == Freshness::Fresh { "(fresh) " } else { "" };
            format!("{mark}{}", compare::table(request, comparison)).trim_end().to_owned()
        }
        StageResult::Diagnose(diagnosis) => diagnose::text(diagnosis),
    }
}
