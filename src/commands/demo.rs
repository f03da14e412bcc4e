//! `demo`: an effect is concealed in a simulated session, found, and compared with the truth.

mod findings;
mod steps;
mod trial;

use super::{Ending, Output, process, record};
use crate::batch;
use crate::cli::{CONCEALABLE, DemoArgs};
use crate::pipeline::{self, PipelineProgress, ProcessRequest, Processed, StageResult};
use crate::prove::SealedTruth;
use anyhow::Context;
use evrig_analysis::diagnose::Diagnosis;
use evrig_session::Session;
use evrig_sim::world::WorldDescription;
use findings::DemoFindings;
use serde_json::json;
use std::path::{Path, PathBuf};
use steps::{DemoStep, StepDisplay};
use trial::SealedPaths;

/// The steps with their shares of the time.
const STEPS: &[DemoStep] = &[
    ("recording on the simulated rig", 0.13),
    ("aligning the cameras and generating events", 0.35),
    ("locating and naming the difference", 0.5),
    ("writing the report", 0.02),
];

/// Pixels of the diagnosis: two thirds of the default, for its time.
const N_PIXELS: usize = 80;

pub(super) fn demo(args: &DemoArgs, output: &Output) -> anyhow::Result<Ending> {
    let out = args.out.clone().unwrap_or_else(free_directory);
    let (world, truth) = concealed_world(args)?;
    let steps = StepDisplay::new(output, STEPS)?;
    let manifest = trial::record(&world, args.seed, &out, &mut |share| steps.done(share))?;
    let sealed = truth.as_ref().map(|truth| SealedPaths::seal(truth, &out)).transpose()?;
    // From here on the truth is known to its file only.
    drop((world, truth));
    steps.next();
    let processed = analyse(&out, &steps)?;
    let diagnosis = diagnosis(&processed).context("the session could not be diagnosed")?;
    let session = Session::open(&out)?;
    let opened = sealed.map(|sealed| sealed.judge(diagnosis)).transpose()?;
    let run = pipeline::read_forward_simulation(&session)?;
    let findings = DemoFindings { diagnosis, opened: opened.as_ref(), run: run.as_ref() };
    steps.next();
    let report = session.layout().report();
    std::fs::write(&report, pipeline::report_with(&session, &findings.remarks())?)
        .with_context(|| format!("cannot write the report to {}", report.display()))?;
    drop(steps);
    let shown = std::path::absolute(&report).unwrap_or_else(|_| report.clone());
    let text = format!("{}report     {}", findings.text(), shown.display());
    let value = json!({
        "schema": "evrig.demo/2", "session": out, "report": report,
        "recording": manifest.streams, "process": process::value(&processed)?,
        "judgement": opened.as_ref().map(|(_, judgement)| judgement),
        "truth": opened.as_ref().map(|(truth, _)| truth),
    });
    output.result(&value, text)?;
    Ok(Ending::Done)
}

/// The world to be recorded, and the truth to be sealed; none of a world that is described by a
/// file or conceals nothing.
fn concealed_world(args: &DemoArgs) -> anyhow::Result<(WorldDescription, Option<SealedTruth>)> {
    match args.world.as_deref() {
        Some(world) if world == Path::new("none") => Ok((WorldDescription::default(), None)),
        Some(world) => Ok((record::world(Some(world))?, None)),
        None => {
            let truth = trial::draw(args.effect.as_deref(), &CONCEALABLE, args.seed);
            Ok((trial::world(&truth)?, Some(truth)))
        }
    }
}

/// Processes the session as any recorded one.
fn analyse(session: &Path, steps: &StepDisplay) -> anyhow::Result<Processed> {
    let is_diagnosing = std::sync::atomic::AtomicBool::new(false);
    let watch = |progress: PipelineProgress<'_>| match progress {
        PipelineProgress::Stage { stage, .. } => steps.detail(stage),
        PipelineProgress::Diagnosis(what) => {
            if !is_diagnosing.swap(true, std::sync::atomic::Ordering::Relaxed) {
                steps.next();
            }
            steps.detail(what);
        }
        PipelineProgress::Message(_) => {}
    };
    let request = ProcessRequest { n_pixels: Some(N_PIXELS), ..ProcessRequest::default() };
    batch::process_session(session, &request, &watch).context("the processing failed")
}

fn diagnosis(processed: &Processed) -> Option<&Diagnosis> {
    processed.results().find_map(|result| match result {
        StageResult::Diagnose(diagnosis) => Some(diagnosis),
        _ => None,
    })
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
