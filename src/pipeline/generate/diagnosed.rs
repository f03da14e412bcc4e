//! Generation with a diagnosed camera: its law, noise and named effects on the whole sensor.

use super::output::{GenerateTally, Generated, all_pixels, open, refuse_recorded, stage};
use crate::pipeline::PipelineError;
use crate::pipeline::diagnose::{Baseline, DiagnosedCamera, default_baseline, read_camera};
use crate::pipeline::error::missing;
use evrig_analysis::diagnose::{FittedRegistration, RegisteredDrive, surroundings};
use evrig_core::drive::Drive;
use evrig_session::{Session, StreamName};
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Request for a generation with a diagnosed camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRequest {
    /// The camera and its signal.
    pub by: By,
    /// Name of the new stream.
    pub name: StreamName,
    /// Seed of all random draws.
    pub seed: u64,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// Source of camera and signal.
#[derive(Debug, Clone, PartialEq)]
pub enum By {
    /// The session's own diagnosis, with its signal and registration.
    Own,
    /// Another session's `camera.json` with a signal of this session; the default baseline without
    /// one. The signal is taken as registered.
    Other(PathBuf, Option<Baseline>),
}

/// A camera with its signal.
struct CameraSetting {
    camera: DiagnosedCamera,
    baseline: Baseline,
    registration: Option<FittedRegistration>,
}

/// Runs the stage, unless its result is fresh. Returns also why the events differ from those of
/// the real camera, a sentence each.
///
/// # Errors
///
/// When camera or signal are missing, an effect lacks its input, or a file cannot be written.
pub fn generate_diagnosed(
    session: &Session,
    request: &CameraRequest,
) -> Result<(Generated, Vec<String>), PipelineError> {
    let name = &request.name;
    refuse_recorded(session, name)?;
    let setting = setting(session, &request.by)?;
    let cautions = setting.camera.cautions();
    let parameters = json!({
        "from": setting.baseline.from(),
        "is_straight": matches!(setting.baseline, Baseline::Frames(_)),
        "named": setting.camera.fitted.named,
        "camera": setting.camera.fitted.camera,
        "registration": setting.registration,
        "seed": request.seed,
    });
    let inputs = setting.baseline.inputs(session)?;
    let made =
        stage(session, name, request.force, inputs, parameters, || run(session, request, setting))?;
    Ok((made, cautions))
}

fn setting(session: &Session, by: &By) -> Result<CameraSetting, PipelineError> {
    match by {
        By::Own => {
            let camera = read_camera(session)?;
            let (baseline, registration) =
                (camera.baseline.clone(), Some(camera.fitted.registration.clone()));
            Ok(CameraSetting { camera, baseline, registration })
        }
        By::Other(file, light) => {
            let camera = DiagnosedCamera::read(file)?;
            let none = || {
                let what = "it has neither a scene nor frames on the events' pixel grid to \
                    generate from; run `evrig scene`, or give --from";
                missing(session, what.into())
            };
            let baseline = light.clone().or_else(|| default_baseline(session)).ok_or_else(none)?;
            Ok(CameraSetting { camera, baseline, registration: None })
        }
    }
}

fn run(
    session: &Session,
    request: &CameraRequest,
    setting: CameraSetting,
) -> Result<(GenerateTally, Duration), PipelineError> {
    let light = setting.baseline.light(session)?;
    let tuned = setting
        .registration
        .map(|registration| RegisteredDrive::new(light.drive.as_ref(), registration));
    let drive = tuned.as_ref().map_or(light.drive.as_ref(), |tuned| tuned as &dyn Drive);
    let camera = setting.camera.fitted.camera;
    let (size, [first_us, last_us]) = (drive.size(), drive.span_us());
    let pixels = all_pixels(size);
    let started = Instant::now();
    let surroundings = surroundings(&light.facts);
    let made = camera.events(drive, &pixels, [first_us, last_us], surroundings, request.seed);
    let made = made.map_err(|source| PipelineError::Forward {
        session: session.root().to_owned(),
        stream: setting.baseline.from().to_owned(),
        source: Box::new(source),
    })?;
    let spent = started.elapsed();
    let step_us = i64::from(camera.generator.step_us);
    let tally = GenerateTally {
        n_frames: ((last_us - first_us) / step_us) as u64 + 1,
        n_events: made.events.len() as u64,
        n_on: made.events.as_slice().count_on() as u64,
        first_us,
        last_us,
        n_pixels: size.n_pixels() as u64,
        ..GenerateTally::default()
    };
    let mut writer = open(session, &request.name, "diagnosed", size)?;
    writer.write_events(0, made.events.as_slice())?;
    writer.finish()?;
    Ok((tally, spent))
}
