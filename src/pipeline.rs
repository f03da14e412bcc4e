//! Stages: from a session's files to new files beside them.
//!
//! A stage's result is in `derived/<stage>[-<stream>]/` with a `stage.json` that names
//! the checksums of its inputs, its parameters and the version; a stage whose record would
//! be the same is fresh and is not run again. Results hold no time of day and no path
//! outside the session, so they are the same bytes on any machine.

mod align;
mod calibrate;
mod compare;
mod conditions;
mod diagnose;
mod error;
mod filter;
mod generate;
mod inputs;
mod interpolation;
mod luminance;
mod model_choice;
mod process;
mod progress;
mod report;
mod scene;
mod scene_source;
mod simulator_arguments;
mod streams;
mod sweep;
mod sync;
mod track;
mod variants;

pub use align::{AlignProgress, Aligned, TrackOutcome, align, track_all};
pub use calibrate::{CalibrateRequest, ObjectiveKind, calibrate, read_calibration};
pub use compare::{CompareRequest, ReferenceStream, compare, compare_with, read_comparison};
pub use conditions::Conditions;
pub use diagnose::{
    Baseline, BaselineKind, DiagnoseRequest, DiagnosedCamera, default_baseline, diagnose,
    read_camera, read_diagnosis, read_forward_simulation, read_heat,
};
pub use error::PipelineError;
pub use filter::{
    FilterRequest, FilterSettings, FilterTally, FilteredStream, common_grid, filter,
    picture_events, read_filter_tally, stream_grid, track_for,
};
pub use generate::{
    By, CameraRequest, ExternalRequest, ExternalSimulator, GenerateRequest, GenerateTally,
    Generated, GenerationSpeed, generate, generate_diagnosed, generate_external,
};
pub use model_choice::ModelChoice;
pub use process::{ProcessRequest, ProcessStep, Processed, SkippedStage, StageResult, process};
pub use progress::PipelineProgress;
pub use report::{report, report_with};
pub use scene::{SceneMade, read_scene, scene, scene_streams};
pub use scene_source::white_of;
pub use simulator_arguments::{OtherSimulator, SimulatorArguments, simulator_arguments};
pub use streams::{
    count_frames, default_light, event_streams, frame_streams, pi_streams, simulated_streams,
};
pub use sweep::{SweepRequest, Swept, sweep};
pub use sync::{SyncTally, Synced, read_clocks, sync};
pub use track::{
    AnyTrack, TrackRequest, TrackSummary, Tracked, read_summary, read_track, track, tracked,
};
pub use variants::{VariantList, VariantRequest, VariantResult, VariantResults, variants};

use evrig_core::stats::read_back;
use evrig_session::{StageRecord, read_stage};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// How a stage came to its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freshness {
    /// It was run now.
    Ran,
    /// Its result was there already, from the same inputs, parameters and version.
    Fresh,
}

/// The record in `directory` if it describes the same run as `wanted` and its outputs are there.
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
    fn a_result_that_is_cut_off_is_reported_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.json");
        assert!(read_json::<Vec<f64>>(path.clone()).unwrap().is_none());
        std::fs::write(&path, "[1.0, null, 2").unwrap();
        let message = read_json::<Vec<f64>>(path.clone()).unwrap_err().to_string();
        assert!(message.contains("numbers.json") && message.contains("--force"), "{message}");
        std::fs::write(&path, "[1.0, null, 2]").unwrap();
        assert!(read_json::<Vec<f64>>(path).unwrap().unwrap()[1].is_nan());
    }
}
