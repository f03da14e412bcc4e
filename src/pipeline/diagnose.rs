//! The stage `diagnose`: which physical effects does the model of this session lack?

mod baseline;
mod camera;
mod clock_tie;
mod departures;

use super::{Freshness, PipelineError, clear, fresh_record, inputs, read_json};
use baseline::BaselineLight;
pub use baseline::{Baseline, BaselineKind, default_baseline};
use camera::{CAMERA, CAMERA_SCHEMA};
pub use camera::{DiagnosedCamera, read_camera};
use evrig_analysis::diagnose::{
    self, Departure, Diagnosis, DiagnosisOptions, DiagnosisResult, Evidence, FittedCamera,
    ForwardSimulation, HeatMap, StampGrid,
};
use evrig_analysis::predict::EventsByPixel;
use evrig_core::drive::Drive;
use evrig_core::event::Events;
use evrig_session::{Session, StageRecord, write_stage};
use serde_json::json;
use std::path::PathBuf;

/// Request for a diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagnoseRequest {
    /// Name of the event stream.
    pub real: String,
    /// Source of the signal.
    pub baseline: Baseline,
    /// Work and resolution.
    pub options: DiagnosisOptions,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// Runs the stage, unless its result is fresh. `progress` receives the name of each step.
///
/// # Errors
///
/// When a stream is missing, signal and events do not overlap, there are too few events, or a file
/// cannot be written.
pub fn diagnose(
    session: &Session,
    request: &DiagnoseRequest,
    progress: &mut dyn FnMut(&str),
) -> Result<(Diagnosis, Freshness), PipelineError> {
    let mut inputs = inputs::of_events(session, &request.real)?;
    inputs.extend(request.baseline.inputs(session)?);
    let parameters = json!({
        "real": request.real,
        "from": request.baseline.from(),
        "is_straight": matches!(request.baseline, Baseline::Frames(_)),
        "options": request.options,
    });
    let wanted = StageRecord::new("diagnose", None, inputs, parameters);
    let directory = session.layout().derived("diagnose", None);
    if !request.force
        && fresh_record(&directory, &wanted).is_some()
        && let Some(diagnosis) = read_diagnosis(session)?
    {
        return Ok((diagnosis, Freshness::Fresh));
    }
    let input = prepare(session, request)?;
    let DiagnosisOutput { diagnosis, run, heat, camera } =
        diagnosed(&input, &request.options, progress);
    clear(&directory)?;
    let write = |name: &str, text: String| {
        let path = directory.join(name);
        std::fs::write(&path, text).map_err(|source| PipelineError::Io { path, source })
    };
    write("diagnosis.json", serde_json::to_string_pretty(&diagnosis).unwrap_or_default())?;
    write(FORWARD_SIMULATION, serde_json::to_string(&run).unwrap_or_default())?;
    write(HEAT, serde_json::to_string(&heat).unwrap_or_default())?;
    let mut outputs = vec!["diagnosis.json", FORWARD_SIMULATION, HEAT];
    if let Some(fitted) = camera {
        let made = DiagnosedCamera {
            schema: CAMERA_SCHEMA.to_owned(),
            verdict: diagnosis.verdict,
            baseline: request.baseline.clone(),
            // The camera is for the whole sensor, not only for the selected pixels.
            fitted: fitted.with_background_up_to(input.most_at_rest_hz),
        };
        write(CAMERA, serde_json::to_string_pretty(&made).unwrap_or_default())?;
        outputs.push(CAMERA);
    }
    let tally = json!({ "n_pixels": diagnosis.n_pixels, "n_events": diagnosis.n_events });
    write_stage(&directory, StageRecord { tally, ..wanted }, &outputs)?;
    Ok((diagnosis, Freshness::Ran))
}

/// What a diagnosis yields beside its result.
struct DiagnosisOutput {
    diagnosis: Diagnosis,
    run: Option<ForwardSimulation>,
    heat: Vec<HeatMap>,
    camera: Option<FittedCamera>,
}

fn diagnosed(
    input: &DiagnosisInput,
    options: &DiagnosisOptions,
    progress: &mut dyn FnMut(&str),
) -> DiagnosisOutput {
    let DiagnosisInput { evidence, departures, drive, events, .. } = input;
    let found = diagnose::diagnose(evidence, departures, options, progress);
    let DiagnosisResult { mut diagnosis, heat, baseline, camera } = found;
    progress("forward simulation");
    let run = baseline.zip(camera.as_ref()).and_then(|(baseline, camera)| {
        let (real, both) = (events.as_slice(), [&baseline, camera]);
        diagnose::simulate_forward(evidence, drive.as_ref(), real, both, options.seed)
    });
    if let Some(run) = &run {
        diagnosis.fit.forward_simulation = run.measures.clone();
    }
    DiagnosisOutput { diagnosis, run, heat, camera }
}

/// File of the forward simulation.
const FORWARD_SIMULATION: &str = "forward_simulation.json";

/// File of the heat maps.
const HEAT: &str = "heat.json";

/// The forward simulation of a session's diagnosis; `None` where the generator was not run.
///
/// # Errors
///
/// When the file cannot be read.
pub fn read_forward_simulation(
    session: &Session,
) -> Result<Option<ForwardSimulation>, PipelineError> {
    let path = result(session, FORWARD_SIMULATION);
    let path = if path.exists() { path } else { result(session, "free_run.json") };
    Ok(read_json(path)?.flatten())
}

/// The heat maps of a session's diagnosis.
///
/// # Errors
///
/// When the file cannot be read.
pub fn read_heat(session: &Session) -> Result<Vec<HeatMap>, PipelineError> {
    Ok(read_json(result(session, HEAT))?.unwrap_or_default())
}

/// A session's diagnosis.
///
/// # Errors
///
/// When the file cannot be read.
pub fn read_diagnosis(session: &Session) -> Result<Option<Diagnosis>, PipelineError> {
    read_json(result(session, "diagnosis.json"))
}

fn result(session: &Session, name: &str) -> PathBuf {
    session.layout().derived("diagnose", None).join(name)
}

/// The data of a diagnosis and their sources.
struct DiagnosisInput {
    evidence: Evidence,
    drive: Box<dyn Drive>,
    /// Recorded events for the forward simulation.
    events: Events,
    departures: Vec<Departure>,
    /// Upper bound on the background rate from silent pixels, Hz.
    most_at_rest_hz: f64,
}

fn prepare(session: &Session, request: &DiagnoseRequest) -> Result<DiagnosisInput, PipelineError> {
    let rig = session.rig()?;
    let BaselineLight { drive, mut facts, scene } = request.baseline.light(session)?;
    let (mut events, _) = session.events(&request.real)?;
    if let Some(grid) = StampGrid::of_events(events.as_slice()) {
        events = grid.spread(events.as_slice());
        facts.stamp_step_us = Some(grid.step_us);
    }
    let [from, to] = drive.span_us();
    let real = events.as_slice();
    let window = match (real.t.first(), real.t.last()) {
        (Some(&first), Some(&last)) => [from.max(first), to.min(last + 1)],
        _ => [from, to],
    };
    let recording =
        EventsByPixel::new(real, drive.size(), [window[0], window[1].max(window[0] + 1)]);
    let evidence = Evidence::new(&recording, drive.as_ref(), facts, &request.options)
        .map_err(|source| PipelineError::Diagnose { session: session.root().to_owned(), source })?;
    let most_at_rest_hz = recording.max_background_hz();
    // A long recording is kept in one copy, by pixel.
    let events = diagnose::events_on_patch(&evidence, drive.size(), events.as_slice());
    let departures = match (scene, rig) {
        (Some(scene), Some(rig)) => departures::departures(&scene, &rig, &evidence),
        _ => Vec::new(),
    };
    Ok(DiagnosisInput { evidence, drive, events, departures, most_at_rest_hz })
}
