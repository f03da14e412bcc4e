//! The stage `diagnose`: which physics does the model leave out in this session?

mod stated;
mod tied;

use super::generate::{aps_starts, scene_inputs};
use super::sync::read_clocks;
use super::{
    Freshness, PipelineError, clear, default_light, fresh_record, inputs, read_json, read_scene,
};
use crate::diagnose::{
    self, Departure, Diagnosis, Evidence, Facts, FreeRun, HeatMap, Options, StampGrid,
};
use crate::drive::Drive;
use crate::event::Events;
use crate::predict::ByPixel;
use crate::scene::{FramesDrive, Scene};
use crate::session::{Session, StageRecord, StreamKind, read_stage, write_stage};
use serde_json::json;
use std::path::PathBuf;

/// What to diagnose.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagnoseRequest {
    /// The events to explain.
    pub real: String,
    /// What the light comes from.
    pub baseline: Baseline,
    /// How hard to look.
    pub options: Options,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// What the light of the event pixels comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Baseline {
    /// The map of the print and the head's path over it.
    Scene,
    /// A frame stream on the events' pixel grid, led along with what moves in between.
    Motion(String),
    /// The same, straight in between: the plain generator from frames.
    Frames(String),
}

/// The scene where the session holds one, else the frames that a generation would start from.
#[must_use]
pub fn default_baseline(session: &Session) -> Option<Baseline> {
    if read_stage(&session.layout().derived("scene", None)).is_some() {
        return Some(Baseline::Scene);
    }
    let size = session.size();
    let on_grid = |name: &&str| {
        session.stream(StreamKind::Frames, name).is_ok_and(|entry| entry.size == size)
    };
    default_light(session).filter(on_grid).map(|light| Baseline::Motion(light.to_owned()))
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
    let mut inputs = inputs::of_events(session, &request.real)?;
    let from = match &request.baseline {
        Baseline::Scene => {
            inputs.extend(scene_inputs(session));
            "scene"
        }
        Baseline::Motion(light) | Baseline::Frames(light) => {
            let entry = session.stream(StreamKind::Frames, light)?;
            inputs.extend(inputs::of_recorded(session, entry));
            light
        }
    };
    let parameters = json!({
        "real": request.real,
        "from": from,
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
    let Looked { evidence, drive, events, departures } = look(session, request)?;
    let found = diagnose::diagnose(&evidence, &departures, &request.options, progress);
    let mut diagnosis = found.diagnosis;
    progress("free run");
    let models = [&found.baseline, &found.model];
    let seed = request.options.seed;
    let run = diagnose::free_run(&evidence, drive.as_ref(), events.as_slice(), models, seed);
    if let Some(run) = &run {
        diagnosis.fit.forward = run.measures.clone();
    }
    clear(&directory)?;
    let write = |name: &str, text: String| {
        let path = directory.join(name);
        std::fs::write(&path, text).map_err(|source| PipelineError::Io { path, source })
    };
    write("diagnosis.json", serde_json::to_string_pretty(&diagnosis).unwrap_or_default())?;
    write(FREE_RUN, serde_json::to_string(&run).unwrap_or_default())?;
    write(HEAT, serde_json::to_string(&found.heat).unwrap_or_default())?;
    let tally = json!({ "n_pixels": diagnosis.n_pixels, "n_events": diagnosis.n_events });
    write_stage(&directory, StageRecord { tally, ..wanted }, &["diagnosis.json", FREE_RUN, HEAT])?;
    Ok((diagnosis, Freshness::Ran))
}

/// The file of the free run beside the diagnosis.
const FREE_RUN: &str = "free_run.json";

/// The heat maps beside the diagnosis.
const HEAT: &str = "heat.json";

/// The free run of the diagnosis that a session holds; none where the generator was not run.
///
/// # Errors
/// When the file is there and cannot be read.
pub fn read_free_run(session: &Session) -> Result<Option<FreeRun>, PipelineError> {
    Ok(read_json(result(session, FREE_RUN))?.flatten())
}

/// The heat maps of the diagnosis that a session holds.
///
/// # Errors
/// When the file is there and cannot be read.
pub fn read_heat(session: &Session) -> Result<Vec<HeatMap>, PipelineError> {
    Ok(read_json(result(session, HEAT))?.unwrap_or_default())
}

/// The diagnosis that a session holds.
///
/// # Errors
/// When the file is there and cannot be read.
pub fn read_diagnosis(session: &Session) -> Result<Option<Diagnosis>, PipelineError> {
    read_json(result(session, "diagnosis.json"))
}

fn result(session: &Session, name: &str) -> PathBuf {
    session.layout().derived("diagnose", None).join(name)
}

/// By how much the scene's tie of the clocks may be off: the DAVIS's frames and events differ by
/// half an exposure at worst, and noise makes crossings early.
const TIED_US: f64 = 1_500.0;

/// By how much events may come beside what the clocks themselves state: noise makes crossings early.
const STATED_US: f64 = 800.0;

/// What a diagnosis looks at, with what it was drawn from.
struct Looked {
    evidence: Evidence,
    drive: Box<dyn Drive>,
    /// Those beside which the generator runs free.
    events: Events,
    departures: Vec<Departure>,
}

fn look(session: &Session, request: &DiagnoseRequest) -> Result<Looked, PipelineError> {
    let missing =
        |what: String| PipelineError::Missing { session: session.root().to_owned(), what };
    let rig = session.rig()?;
    let mut mapped = None;
    let (drive, mut facts): (Box<dyn Drive>, Facts) = match &request.baseline {
        Baseline::Scene => {
            let scene = read_scene(session)?
                .ok_or_else(|| missing("it holds no scene; run `evrig scene` first".into()))?;
            let drive = scene.drive();
            let clocks = read_clocks(session)?;
            let later_us = rig.as_ref().map_or(0.0, |rig| stated::later_us(&scene, rig));
            let clocks = clocks.and_then(|clocks| tied::tied_clocks(&scene, &clocks, later_us));
            let facts = Facts {
                from_scene: true,
                is_led: false,
                aps_us: aps_starts(session)?,
                frame_us: 0.0,
                white_dn: drive.white_dn(),
                light_per_pedestal: light_per_pedestal(&scene),
                offset_within_us: if clocks.is_some() { STATED_US } else { TIED_US },
                clocks,
                pixel_mm: Some(scene.registration.pixel_mm),
                frames_show: stated::shown(&scene, rig.as_ref()),
                stamp_step_us: None,
            };
            mapped = Some(scene);
            (Box::new(drive), facts)
        }
        Baseline::Motion(light) | Baseline::Frames(light) => {
            let (drive, mut facts) = frames(session, light)?;
            facts.is_led =
                matches!(request.baseline, Baseline::Motion(_)) && !facts.is_light_dense();
            let drive = if facts.is_led {
                drive.without_clipped().led_by_motion().steadied()
            } else {
                drive
            };
            (Box::new(drive), facts)
        }
    };
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
    let recording = ByPixel::new(real, drive.size(), [window[0], window[1].max(window[0] + 1)]);
    let evidence = Evidence::new(&recording, drive.as_ref(), facts, &request.options)
        .map_err(|source| PipelineError::Diagnose { session: session.root().to_owned(), source })?;
    // A long recording is held pixel by pixel from here on, not twice.
    let events = diagnose::beside_free_run(&evidence, drive.size(), events.as_slice());
    let departures = match (mapped, rig) {
        (Some(scene), Some(rig)) => stated::departures(&scene, &rig, &evidence),
        _ => Vec::new(),
    };
    Ok(Looked { evidence, drive, events, departures })
}

/// What a pedestal of one digital unit adds to the map, in which each place of the mosaic is scaled to
/// the brightest and weighs by its gain.
fn light_per_pedestal(scene: &Scene) -> f64 {
    4.0 / scene.survey.site_gains.iter().sum::<f64>()
}

/// The drive from frames of the event camera itself.
fn frames(session: &Session, light: &str) -> Result<(FramesDrive, Facts), PipelineError> {
    let missing =
        |what: String| PipelineError::Missing { session: session.root().to_owned(), what };
    let size = session.size().ok_or_else(|| missing("no stream states its pixel grid".into()))?;
    let mut unreadable = None;
    let frames = session.luminance(light)?;
    let frames = frames.map_while(|frame| frame.map_err(|error| unreadable = Some(error)).ok());
    let drive = FramesDrive::new(frames, 0.0, 0.0);
    if let Some(error) = unreadable {
        return Err(error.into());
    }
    let drive = drive.map_err(|error| missing(format!("`{light}`: {error}")))?;
    if drive.size() != size {
        return Err(missing(format!("`{light}` does not lie on the events' pixel grid of {size}")));
    }
    let times = drive.times_us();
    let facts = Facts {
        from_scene: false,
        is_led: false,
        aps_us: times.to_vec(),
        frame_us: (times[times.len() - 1] - times[0]) as f64 / (times.len() - 1).max(1) as f64,
        white_dn: drive.white_dn(),
        light_per_pedestal: 1.0,
        offset_within_us: SAME_CAMERA_US,
        clocks: None,
        pixel_mm: None,
        frames_show: Vec::new(),
        stamp_step_us: None,
    };
    Ok((drive, facts))
}
