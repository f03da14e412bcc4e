//! The stage `calibrate`: the generator's constants from a session's frames and real events.

mod signal;

use super::scene_source::{self, is_scene};
use super::{
    Freshness, PipelineError, clear, fresh_record, inputs, luminance, read_json, track, tracked,
};
use evrig_analysis::calibrate::{self, CalibrateError, Calibration, EmdObjective, Objective};
use evrig_analysis::calibrate::{CalibrationSettings, ScoreObjective};
use evrig_session::{Session, StageRecord, StreamName, write_stage};
use serde::{Deserialize, Serialize};
use serde_json::json;

/// What a search makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObjectiveKind {
    /// The predictive log score of the real events.
    Score,
    /// The paper's normalised earth mover's distance.
    Emd,
}

/// What to calibrate.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrateRequest {
    /// The source of the signal: name of a frame stream of either camera, or `scene`.
    pub from: String,
    /// The reference events.
    pub real: String,
    /// What the search makes small.
    pub objective: ObjectiveKind,
    /// Evaluations of the search; with 0 there is none.
    pub n_evaluations: usize,
    /// Seed of all draws.
    pub seed: u64,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// Runs the stage, unless its result is fresh.
///
/// # Errors
/// When a stream is missing, the events do not determine the constants, or the disk refuses.
pub fn calibrate(
    session: &Session,
    request: &CalibrateRequest,
) -> Result<(Calibration, Freshness), PipelineError> {
    let mut inputs = inputs_of(session, &request.from)?;
    inputs.extend(inputs::of_events(session, &request.real)?);
    let parameters = json!({
        "from": request.from,
        "real": request.real,
        "objective": request.objective,
        "n_evaluations": request.n_evaluations,
        "seed": request.seed,
    });
    let name = StreamName::new(&request.from)?;
    let wanted = StageRecord::new("calibrate", Some(name.as_str()), inputs, parameters);
    let directory = session.layout().derived("calibrate", Some(&name));
    if !request.force
        && fresh_record(&directory, &wanted).is_some()
        && let Some(calibration) = read_calibration(session, &name)?
    {
        return Ok((calibration, Freshness::Fresh));
    }
    let calibration = run(session, request)?;
    clear(&directory)?;
    let path = directory.join("k.json");
    let io = |source| PipelineError::Io { path: path.clone(), source };
    let text = serde_json::to_string_pretty(&calibration).map_err(|e| io(e.into()))?;
    std::fs::write(&path, text + "\n").map_err(io)?;
    let tally = json!({
        "n_passages": calibration.passages.n_used,
        "n_passages_open": calibration.passages.n_open,
        "n_evaluations": calibration.n_evaluations,
    });
    write_stage(&directory, StageRecord { tally, ..wanted }, &["k.json"])?;
    Ok((calibration, Freshness::Ran))
}

/// Checksums of the sources of the signal: frames and, for the Pi's, both tracks and the clocks.
fn inputs_of(session: &Session, from: &str) -> Result<inputs::Inputs, PipelineError> {
    if is_scene(session, from) {
        return Ok(scene_source::inputs_of(session));
    }
    let mut inputs = luminance::inputs_of(session, from)?;
    if session.is_from_pi(from)? {
        for stream in tracked(session) {
            inputs.extend(track::outputs(session, &stream)?);
        }
    }
    Ok(inputs)
}

fn failed(session: &Session, source: CalibrateError) -> PipelineError {
    PipelineError::Calibrate { session: session.root().to_owned(), source }
}

fn run(session: &Session, request: &CalibrateRequest) -> Result<Calibration, PipelineError> {
    let (events, _) = session.events(&request.real)?;
    let found = signal::calibration_signal(session, &request.from, request.seed)?;
    let settings = CalibrationSettings {
        published: found.published,
        n_evaluations: request.n_evaluations,
        seed: request.seed,
    };
    let (light, events) = (&found.light, events.as_slice());
    let objective: Box<dyn Objective> = match request.objective {
        ObjectiveKind::Score => Box::new(ScoreObjective::new(light, events, request.seed)),
        ObjectiveKind::Emd => Box::new(EmdObjective::new(light, events, request.seed)),
    };
    let calibration = calibrate::calibrate(light, events, objective.as_ref(), &settings);
    let calibration = calibration.map_err(|source| failed(session, source))?;
    Ok(Calibration { preparation: found.preparation, ..calibration })
}

/// The calibration that a session holds for a signal; `None` without one.
///
/// # Errors
/// When its file cannot be read.
pub fn read_calibration(
    session: &Session,
    light: &StreamName,
) -> Result<Option<Calibration>, PipelineError> {
    read_json(session.layout().derived("calibrate", Some(light)).join("k.json"))
}
