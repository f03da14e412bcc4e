//! Stages: from a session's files to new files beside them.
//!
//! A stage's result lies in `derived/<stage>[-<stream>]/` with a `stage.json` that names
//! the checksums of its inputs, its parameters and the version; a stage whose record would
//! be the same is fresh and is not run again. Results hold no time of day and no path
//! outside the session, so that they are the same bytes on any machine.

mod align;
mod between;
mod calibrate;
mod compare;
mod diagnose;
mod filter;
mod generate;
mod inputs;
mod light;
mod report;
mod scene;
mod sweep;
mod sync;
mod track;

pub use align::{AlignProgress, Aligned, TrackOutcome, align, frame_streams, track_all};
pub use calibrate::{CalibrateRequest, ObjectiveKind, calibrate, read_calibration};
pub use compare::{CompareRequest, Reference, compare, compare_with, read_comparison};
pub use diagnose::{
    Baseline, DiagnoseRequest, DiagnosedCamera, default_baseline, diagnose, read_camera,
    read_diagnosis, read_free_run, read_heat,
};
pub use filter::{
    FilterRequest, FilterSettings, FilterTally, FilteredStream, filter, picture_events,
    read_filter_tally, stream_grid, track_for,
};
pub use generate::{
    By, CameraRequest, Conditions, GenerateRequest, Generated, GenerationSpeed, default_light,
    generate, generate_diagnosed, white_of,
};
pub use light::{Light, light};
pub use report::report;
pub use scene::{SceneMade, read_scene, scene, scene_streams};
pub use sweep::{SweepRequest, Swept, sweep};
pub use sync::{SyncTally, Synced, pi_streams, read_clocks, sync};
pub use track::{
    AnyTrack, TrackRequest, TrackSummary, Tracked, read_summary, read_track, track, tracked,
};

use evrig_analysis::calibrate::CalibrateError;
use evrig_analysis::compare::CompareError;
use evrig_analysis::diagnose::DiagnoseError;
use evrig_analysis::filter::FilterError;
use evrig_core::stats::read_back;
use evrig_format::aedat4::WriteError;
use evrig_generate::forward::ForwardError;
use evrig_generate::{GenerateError, ParameterError};
use evrig_reconstruct::clock::ClockError;
use evrig_reconstruct::roi::TrackError;
use evrig_reconstruct::scene::{FramesError, SceneError};
use evrig_report::page::PageError;
use evrig_report::plot::pixel_image::PixelImageError;
use evrig_session::{SessionError, StageRecord, read_stage};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Why a stage failed.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The session cannot be read or written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Frames cannot be turned into events.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Generate {
        /// The session.
        session: PathBuf,
        /// The light.
        stream: String,
        /// What is wrong with which frame.
        source: GenerateError,
    },
    /// The clocks cannot be put together.
    #[error("the clocks of {session}: {source}", session = session.display())]
    Clock {
        /// The session.
        session: PathBuf,
        /// What is wrong.
        source: ClockError,
    },
    /// No map of the print can be made, or the event camera cannot be tied to it.
    #[error("scene: {0}")]
    Scene(#[from] SceneError),
    /// The tag cannot be tracked.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Track {
        /// The session.
        session: PathBuf,
        /// The frames.
        stream: String,
        /// What is wrong.
        source: Box<TrackError>,
    },
    /// Events cannot be filtered.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Filter {
        /// The session.
        session: PathBuf,
        /// The events, or the track behind their region.
        stream: String,
        /// What is wrong.
        source: FilterError,
    },
    /// Effects or light of a generation cannot be used.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Forward {
        /// The session.
        session: PathBuf,
        /// The light.
        stream: String,
        /// What is wrong.
        source: Box<ForwardError>,
    },
    /// Frames cannot serve as light at any time.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Frames {
        /// The session.
        session: PathBuf,
        /// The light.
        stream: String,
        /// What is wrong.
        source: FramesError,
    },
    /// The generator's parameters cannot be used.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// Constants cannot be told from the session.
    #[error("calibrating on {session}: {source}", session = session.display())]
    Calibrate {
        /// The session.
        session: PathBuf,
        /// What is wrong.
        source: CalibrateError,
    },
    /// Events cannot be compared.
    #[error("comparing `{simulated}` with `{real}` in {session}: {source}", session = session.display())]
    Compare {
        /// The session.
        session: PathBuf,
        /// The reference stream.
        real: String,
        /// The simulated stream.
        simulated: String,
        /// What is wrong.
        source: CompareError,
    },
    /// A session cannot be diagnosed.
    #[error("diagnosing {session}: {source}", session = session.display())]
    Diagnose {
        /// The session.
        session: PathBuf,
        /// What is missing and what to do.
        source: DiagnoseError,
    },
    /// A stage lacks what it needs.
    #[error("{session}: {what}", session = session.display())]
    Missing {
        /// The session.
        session: PathBuf,
        /// What is missing and what to do.
        what: String,
    },
    /// A picture of the report cannot be drawn.
    #[error("the report cannot be drawn: {0}; run the stage `compare` again with --force")]
    Picture(#[source] PixelImageError),
    /// The report cannot be set.
    #[error(transparent)]
    Page(#[from] PageError),
    /// A result cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A result is not what its stage wrote.
    #[error("{path}: not what its stage wrote: {source}; run that stage again with --force", path = path.display())]
    Damaged {
        /// The result.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// The system refused.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

/// How a stage came to its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freshness {
    /// It was run now.
    Ran,
    /// Its result was there already, from the same inputs, parameters and version.
    Fresh,
}

/// The record in `directory` if it tells of the same run as `wanted` and its outputs are there.
fn fresh_record(directory: &Path, wanted: &StageRecord) -> Option<StageRecord> {
    let record = read_stage(directory)?;
    let has_outputs = record.outputs.keys().all(|name| directory.join(name).exists());
    (record.is_same_run(wanted) && has_outputs).then_some(record)
}

/// What a stage wrote as JSON; none where the file is not there.
fn read_json<T: DeserializeOwned>(path: PathBuf) -> Result<Option<T>, PipelineError> {
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(PipelineError::Io { path, source }),
    };
    read_result(path, &text).map(Some)
}

fn read_result<T: DeserializeOwned>(path: PathBuf, text: &str) -> Result<T, PipelineError> {
    read_back(text).map_err(|source| PipelineError::Damaged { path, source })
}

/// Empties a stage's directory, or makes it. The record goes first: a stage that is cut
/// off while it runs leaves no record, and so is stale.
fn clear(directory: &Path) -> Result<(), PipelineError> {
    let io = |source| PipelineError::Io { path: directory.to_owned(), source };
    if directory.exists() {
        std::fs::remove_file(directory.join("stage.json")).or_else(ignore_missing).map_err(io)?;
        std::fs::remove_dir_all(directory).map_err(io)?;
    }
    std::fs::create_dir_all(directory).map_err(io)
}

fn ignore_missing(error: std::io::Error) -> std::io::Result<()> {
    if error.kind() == std::io::ErrorKind::NotFound { Ok(()) } else { Err(error) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_that_is_cut_off_is_told_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.json");
        assert!(read_json::<Vec<f64>>(path.clone()).unwrap().is_none());
        std::fs::write(&path, "[1.0, null, 2").unwrap();
        let said = read_json::<Vec<f64>>(path.clone()).unwrap_err().to_string();
        assert!(said.contains("numbers.json") && said.contains("--force"), "{said}");
        std::fs::write(&path, "[1.0, null, 2]").unwrap();
        assert!(read_json::<Vec<f64>>(path).unwrap().unwrap()[1].is_nan());
    }
}
