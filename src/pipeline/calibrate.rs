//! The stage `calibrate`: the generator's constants from a session's frames and real events.

use super::{Freshness, PipelineError, clear, fresh_record, inputs};
use crate::calibrate::{self, Calibration, EmdObjective, Light, LightBuilder, Objective};
use crate::calibrate::{ScoreObjective, Settings};
use crate::generate::voltmeter::Coefficients;
use crate::session::{Session, StageRecord, StreamKind, StreamName, write_stage};
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
    /// The light: name of a frame stream.
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

/// White of an 8-bit frame, DN: brighter frames are of 10 bits.
const WHITE_8_BIT_DN: f32 = 255.0;

/// Runs the stage, unless its result is fresh.
///
/// # Errors
/// When a stream is missing, the events do not determine the constants, or the disk refuses.
pub fn calibrate(
    session: &Session,
    request: &CalibrateRequest,
) -> Result<(Calibration, Freshness), PipelineError> {
    let light = session.stream(StreamKind::Frames, &request.from)?;
    let mut inputs = inputs::of_recorded(session, light);
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
    let calibration = run(session, request, light.count)?;
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

fn run(
    session: &Session,
    request: &CalibrateRequest,
    n_frames: u64,
) -> Result<Calibration, PipelineError> {
    let failed = |source| PipelineError::Calibrate { session: session.root().to_owned(), source };
    let (events, _) = session.events(&request.real)?;
    let mut builder: Option<LightBuilder> = None;
    let mut brightest = 0.0_f32;
    for frame in session.luminance(&request.from)? {
        let frame = frame?;
        brightest = frame.values.iter().copied().fold(brightest, f32::max);
        let new = || LightBuilder::new(frame.size, n_frames, request.seed);
        builder.get_or_insert_with(new).push(&frame).map_err(failed)?;
    }
    let light: Light = match builder {
        Some(builder) => builder.finish().map_err(failed)?,
        None => return Err(failed(calibrate::CalibrateError::TooFewFrames { n: 0 })),
    };
    let settings = Settings {
        published: if brightest > WHITE_8_BIT_DN {
            Coefficients::RAW2DVS346
        } else {
            Coefficients::DVS346
        },
        n_evaluations: request.n_evaluations,
        seed: request.seed,
    };
    let events = events.as_slice();
    let objective: Box<dyn Objective> = match request.objective {
        ObjectiveKind::Score => Box::new(ScoreObjective::new(&light, events, request.seed)),
        ObjectiveKind::Emd => Box::new(EmdObjective::new(&light, events, request.seed)),
    };
    calibrate::calibrate(&light, events, objective.as_ref(), &settings).map_err(failed)
}

/// The calibration that a session holds for a light; `None` without one.
///
/// # Errors
/// When its file cannot be read.
pub fn read_calibration(
    session: &Session,
    light: &StreamName,
) -> Result<Option<Calibration>, PipelineError> {
    let path = session.layout().derived("calibrate", Some(light)).join("k.json");
    let io = |source| PipelineError::Io { path: path.clone(), source };
    match std::fs::read_to_string(&path) {
        Ok(text) => serde_json::from_str(&text).map(Some).map_err(|e| io(e.into())),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(io(error)),
    }
}
