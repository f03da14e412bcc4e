//! The stage `compare`: a simulated stream against the real one.

use super::{Freshness, PipelineError, clear, fresh_record, inputs};
use crate::compare::{self, Comparison, Maps, Setup};
use crate::format::npy::{Npz, NpzWriter};
use crate::frame::Luminance;
use crate::geometry::Size;
use crate::session::{
    Session, SessionError, StageRecord, StreamKind, StreamName, read_stage, write_stage,
};
use serde_json::json;
use std::path::Path;

/// Resamplings behind each error.
const N_BOOTSTRAP: usize = 400;

/// What to compare.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompareRequest {
    /// The reference stream.
    pub real: String,
    /// The simulated stream.
    pub simulated: StreamName,
    /// Seed of the resampling.
    pub seed: u64,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// Runs the stage, unless its result is fresh.
///
/// The window is the time both streams can have events in: a generated stream's, from its
/// first frame to its last; for a stream simulated elsewhere, the overlap of the two.
///
/// # Errors
/// When a stream is missing, the two do not overlap in time, or the disk refuses.
pub fn compare(
    session: &Session,
    request: &CompareRequest,
) -> Result<(Comparison, Freshness), PipelineError> {
    let simulated_name = request.simulated.as_str();
    let mut inputs = inputs::of_events(session, &request.real)?;
    inputs.extend(inputs::of_events(session, simulated_name)?);
    let light = light_of(session, &request.simulated);
    if let Some(light) = &light {
        let entry = session.stream(StreamKind::Frames, light)?;
        inputs.extend(inputs::of_recorded(session, entry));
    }
    let parameters = json!({
        "real": request.real,
        "simulated": simulated_name,
        "light": light,
        "seed": request.seed,
        "n_bootstrap": N_BOOTSTRAP,
    });
    let wanted = StageRecord::new("compare", Some(simulated_name), inputs, parameters);
    let directory = session.layout().derived("compare", Some(&request.simulated));
    if !request.force && fresh_record(&directory, &wanted).is_some() {
        if let Some(comparison) = read_comparison(session, &request.simulated)? {
            return Ok((comparison, Freshness::Fresh));
        }
    }
    let comparison = run(session, request, light.as_deref())?;
    clear(&directory)?;
    write(&directory, &comparison)?;
    let tally = json!({ "n_real": comparison.n_real, "n_simulated": comparison.n_simulated });
    write_stage(&directory, StageRecord { tally, ..wanted }, &["comparison.json", "maps.npz"])?;
    Ok((comparison, Freshness::Ran))
}

/// The frame stream a generated stream came from.
fn light_of(session: &Session, simulated: &StreamName) -> Option<String> {
    let record = read_stage(&session.layout().derived("generate", Some(simulated)))?;
    record.parameters.get("from")?.as_str().map(str::to_owned)
}

fn run(
    session: &Session,
    request: &CompareRequest,
    light: Option<&str>,
) -> Result<Comparison, PipelineError> {
    let (real, _) = session.events(&request.real)?;
    let (simulated, _) = session.events(request.simulated.as_str())?;
    let missing = |what: String| PipelineError::Missing { session: session.root().to_owned(), what };
    let size = session.size().ok_or_else(|| missing("no stream states its pixel grid".into()))?;
    let (real, simulated) = (real.as_slice(), simulated.as_slice());
    let span = |t: &[i64]| t.first().copied().zip(t.last().copied());
    let mut changes = None;
    let window = match light {
        Some(light) => {
            let (times, logs) = log_brightness(session, light)?;
            let ends = times.first().copied().zip(times.last().copied());
            changes = Some((times, logs));
            ends
        }
        None => match (span(real.t), span(simulated.t)) {
            (Some(a), Some(b)) => Some((a.0.max(b.0), a.1.min(b.1) + 1)),
            _ => None,
        },
    };
    let window = window.filter(|(start, end)| start < end).ok_or_else(|| {
        missing(format!("`{}` and `{}` do not overlap in time", request.real, request.simulated))
    })?;
    let setup = Setup {
        size,
        window: [window.0, window.1],
        region: None,
        seed: request.seed,
        n_bootstrap: N_BOOTSTRAP,
        frames: changes.as_ref().map(|(times, logs)| compare::FrameChanges { times_us: times, log_brightness: logs }),
    };
    compare::compare(real, simulated, &setup).map_err(|source| PipelineError::Compare {
        session: session.root().to_owned(),
        real: request.real.clone(),
        simulated: request.simulated.to_string(),
        source,
    })
}

/// Times of the frames and the logarithm of brightness of each, frame after frame.
fn log_brightness(
    session: &Session,
    light: &str,
) -> Result<(Vec<i64>, Vec<Vec<f32>>), PipelineError> {
    let mut times = Vec::new();
    let mut logs = Vec::new();
    for frame in session.luminance(light)? {
        let Luminance { t_us, values, .. } = frame?;
        times.push(t_us);
        // One digital unit keeps the logarithm of a dark pixel finite.
        logs.push(values.iter().map(|value| (value + 1.0).ln()).collect());
    }
    Ok((times, logs))
}

fn write(directory: &Path, comparison: &Comparison) -> Result<(), PipelineError> {
    let path = directory.join("comparison.json");
    let io = |source| PipelineError::Io { path: path.clone(), source };
    let text = serde_json::to_string_pretty(comparison).map_err(|e| io(e.into()))?;
    std::fs::write(&path, text + "\n").map_err(io)?;
    let Size { width, height } = comparison.maps.size;
    let shape = [u64::from(height), u64::from(width)];
    let mut npz = NpzWriter::create(&directory.join("maps.npz")).map_err(SessionError::from)?;
    for (name, map) in named_maps(&comparison.maps) {
        npz.add(name, &shape, map.iter().copied()).map_err(SessionError::from)?;
    }
    Ok(npz.finish().map_err(SessionError::from)?)
}
