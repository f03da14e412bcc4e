//! The stage `diagnose`: which physics does the model leave out in this session?

use super::{Freshness, PipelineError, clear, fresh_record, inputs};
use crate::diagnose::{self, Diagnosis, Evidence, Facts, Options};
use crate::predict::ByPixel;
use crate::scene::FramesDrive;
use crate::session::{Session, StageRecord, StreamKind, write_stage};
use serde_json::json;

/// What to diagnose.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagnoseRequest {
    /// The events to explain.
    pub real: String,
    /// The light: name of a frame stream on the events' pixel grid.
    pub from: String,
    /// How hard to look.
    pub options: Options,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// By how much the clock of the camera's own frames may be off against its events: half an
/// exposure that a writer put elsewhere.
const SAME_CAMERA_US: f64 = 1_500.0;

/// Runs the stage, unless its result is fresh. `progress` is told what is being looked at.
///
/// # Errors
/// When a stream is missing, light and events do not overlap, there are too few events, or the
/// disk refuses.
pub fn diagnose(
    session: &Session,
    request: &DiagnoseRequest,
    progress: &mut dyn FnMut(&str),
) -> Result<(Diagnosis, Freshness), PipelineError> {
    let light = session.stream(StreamKind::Frames, &request.from)?;
    let mut inputs = inputs::of_events(session, &request.real)?;
    inputs.extend(inputs::of_recorded(session, light));
    let parameters = json!({
        "real": request.real,
        "baseline": "frames",
        "from": request.from,
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
    let evidence = evidence(session, request)?;
    let diagnosis = diagnose::diagnose(&evidence, &request.options, progress);
    clear(&directory)?;
    let path = directory.join("diagnosis.json");
    let text = serde_json::to_string_pretty(&diagnosis).unwrap_or_default();
    std::fs::write(&path, text).map_err(|source| PipelineError::Io { path, source })?;
    let tally = json!({ "n_pixels": diagnosis.n_pixels, "n_events": diagnosis.n_events });
    write_stage(&directory, StageRecord { tally, ..wanted }, &["diagnosis.json"])?;
    Ok((diagnosis, Freshness::Ran))
}

/// The diagnosis that a session holds.
///
/// # Errors
/// When the file is there and cannot be read.
pub fn read_diagnosis(session: &Session) -> Result<Option<Diagnosis>, PipelineError> {
    let path = session.layout().derived("diagnose", None).join("diagnosis.json");
    if !path.exists() {
        return Ok(None);
    }
    let io = |source| PipelineError::Io { path: path.clone(), source };
    let text = std::fs::read_to_string(&path).map_err(io)?;
    let read = serde_json::from_str(&text);
    read.map(Some).map_err(|error| io(std::io::Error::new(std::io::ErrorKind::InvalidData, error)))
}

fn evidence(session: &Session, request: &DiagnoseRequest) -> Result<Evidence, PipelineError> {
    let missing =
        |what: String| PipelineError::Missing { session: session.root().to_owned(), what };
    let (events, _) = session.events(&request.real)?;
    let size = session.size().ok_or_else(|| missing("no stream states its pixel grid".into()))?;
    let frames: Vec<_> = session.luminance(&request.from)?.collect::<Result<_, _>>()?;
    if frames.first().is_some_and(|frame| frame.size != size) {
        return Err(missing(format!(
            "`{}` does not lie on the events' pixel grid of {size}",
            request.from
        )));
    }
    let drive = FramesDrive::new(&frames, 0.0, 0.0)
        .map_err(|error| missing(format!("`{}`: {error}", request.from)))?;
    let times = drive.times_us();
    let span = [times[0], times[times.len() - 1]];
    let facts = Facts {
        from_scene: false,
        aps_us: times.to_vec(),
        frame_us: (span[1] - span[0]) as f64 / (times.len() - 1).max(1) as f64,
        white_dn: crate::drive::Drive::white_dn(&drive),
        offset_within_us: SAME_CAMERA_US,
    };
    let recording = ByPixel::new(events.as_slice(), size, span);
    Evidence::new(&recording, &drive, facts, &request.options)
        .map_err(|source| PipelineError::Diagnose { session: session.root().to_owned(), source })
}
