//! The stage `scene`: the reconstructed target, the camera path, and the registered event camera.

use super::error::missing;
use super::sync::read_clocks;
use super::{
    AnyTrack, Freshness, PipelineError, clear, fresh_record, inputs, read_result, read_track, track,
};
use evrig_core::time::{ClockMap, Davis, PiSensor};
use evrig_format::npy::{ArrayReader, ArrayWriter, Column, Element};
use evrig_reconstruct::roi::Lens;
use evrig_reconstruct::scene::{
    DavisInputs, FrameVisitor, PATH_COLUMNS, PiInputs, RawFrames, RawLevels, Scene,
    SceneParameters, align_davis, reconstruct_target,
};
use evrig_session::rig::{CameraDescription, Mount};
use evrig_session::{
    RecordedFrame, Session, SessionError, StageRecord, StreamKind, read_stage, write_stage,
};
use serde_json::json;
use std::path::Path;

/// A scene's facts and how they came about.
#[derive(Debug, Clone)]
pub struct SceneMade {
    /// Everything but the arrays.
    pub facts: SceneParameters,
    /// Whether it ran now.
    pub freshness: Freshness,
}

/// Files of the stage.
const OUTPUTS: [&str; 4] = ["scene.json", "map.npy", "map_error.npy", "path.npy"];

/// A session's raw frames, read anew each time.
struct Recorded<'a> {
    session: &'a Session,
    stream: &'a str,
    progress: &'a mut dyn FnMut(u64, u64),
    n_done: u64,
    n_all: u64,
}

impl RawFrames for Recorded<'_> {
    type Error = PipelineError;

    fn replay(&mut self, see: &mut FrameVisitor<'_>) -> Result<(), PipelineError> {
        for image in self.session.pi_frames(self.stream)? {
            let image = image?;
            see(image.number as usize, &image.frame)?;
            self.n_done += 1;
            (self.progress)(self.n_done, self.n_all.max(self.n_done));
        }
        Ok(())
    }
}

/// Names of the raw stream of the Pi and the frame stream of the event camera, where both are
/// recorded.
///
/// # Errors
/// With the reason why there can be no scene.
pub fn scene_streams(session: &Session) -> Result<[&str; 2], PipelineError> {
    let of = |name: &'static str, is_from_pi: bool| {
        let stream = session.stream(StreamKind::Frames, name).ok();
        let fits = |_: &_| session.is_from_pi(name).unwrap_or(!is_from_pi) == is_from_pi;
        stream.filter(fits).map(|_| name)
    };
    match (of("raw", true), of("aps", false)) {
        (Some(raw), Some(aps)) => Ok([raw, aps]),
        (None, _) => Err(missing(session, "no raw frames of the Pi to map the target".into())),
        (_, None) => {
            let what = "no frames of the event camera, without which nothing ties its pixels to \
                the map; record with APS frames on, or take `diagnose --baseline frames`";
            Err(missing(session, what.into()))
        }
    }
}

/// Runs the stage, unless its result is fresh. `progress` takes frames done and in all.
///
/// # Errors
/// When tracks or clocks are missing, the images fit no geometry, or the disk refuses.
pub fn scene(
    session: &Session,
    force: bool,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<SceneMade, PipelineError> {
    let [raw, aps] = scene_streams(session)?;
    let mut inputs = inputs::Inputs::new();
    for stream in [raw, aps] {
        inputs.extend(super::luminance::inputs_of(session, stream)?);
        inputs.extend(track::outputs(session, stream)?);
    }
    let wanted = StageRecord::new("scene", None, inputs, json!({}));
    let directory = session.layout().derived("scene", None);
    if !force && fresh_record(&directory, &wanted).is_some() {
        let facts = read_facts(&directory)?;
        return Ok(SceneMade { facts, freshness: Freshness::Fresh });
    }
    let scene = make(session, [raw, aps], progress)?;
    clear(&directory)?;
    write(&directory, &scene)?;
    let facts = scene.parameters();
    let tally = json!({
        "n_frames": facts.n_frames[0],
        "n_lost": facts.n_frames[1],
        "n_bridged": facts.n_bridged,
        "n_frames_of_events_camera": facts.registration.n_frames,
        "residual_px": facts.registration.residual_px,
        "residual_dn": facts.registration.residual_dn,
    });
    write_stage(&directory, StageRecord { tally, ..wanted }, &OUTPUTS)?;
    Ok(SceneMade { facts, freshness: Freshness::Ran })
}

fn make(
    session: &Session,
    [raw, aps]: [&str; 2],
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Scene, PipelineError> {
    let cameras = cameras(session, [raw, aps])?;
    let no_track = |stream| missing(session, format!("`{stream}` has no track; run `evrig track`"));
    let Some(AnyTrack::Pi(pi_track)) = read_track(session, raw)? else { return Err(no_track(raw)) };
    let Some(AnyTrack::Davis(davis_track)) = read_track(session, aps)? else {
        return Err(no_track(aps));
    };
    let known = PiInputs {
        size: cameras.pi.size,
        lens: Lens::of(&cameras.pi),
        raw: raw_light(session, raw)?,
        row_time: cameras.pi.row_time,
        mount: cameras.mount,
        track: &pi_track,
    };
    let n_all = 2 * session.stream(StreamKind::Frames, raw)?.count;
    let mut footage = Recorded { session, stream: raw, progress, n_done: 0, n_all };
    let mut reconstruction = reconstruct_target(&known, &mut footage)?;
    let frames: Result<Vec<_>, SessionError> =
        session.davis_frames(aps)?.map(|image| Ok(image?.frame)).collect();
    let pi_from_davis = pi_from_davis(session, &reconstruction.path)?;
    let known = DavisInputs {
        lens: Lens::of(&cameras.davis),
        mount: cameras.mount,
        track: &davis_track,
        pi_from_davis,
        is_measured: cameras.are_measured,
    };
    let registration = align_davis(&mut reconstruction, &known, &frames?)?;
    Ok(Scene { size: cameras.davis.size, reconstruction, registration })
}

/// The cameras and where they sit.
struct Cameras {
    pi: CameraDescription,
    davis: CameraDescription,
    mount: Mount,
    /// Whether this is the rig that the session was recorded with.
    are_measured: bool,
}

/// The session's own rig; for the published layout the published geometry, which states only
/// roughly how the cameras sat.
fn cameras(session: &Session, [raw, aps]: [&str; 2]) -> Result<Cameras, PipelineError> {
    let own = session.rig()?;
    let are_measured = own.is_some();
    let rig = match own {
        Some(rig) => Some(rig),
        None => track::published(session)?,
    };
    let rig = rig.ok_or_else(|| missing(session, "no rig states where the cameras sit".into()))?;
    let size = |name| session.stream(StreamKind::Frames, name).map(|entry| entry.size);
    Ok(Cameras {
        pi: track::fitted(&rig.pi.camera, size(raw)?),
        davis: track::fitted(&rig.davis.camera, size(aps)?),
        mount: rig.mount,
        are_measured,
    })
}

/// What the samples of the raw stream mean, from its first frame.
fn raw_light(session: &Session, raw: &str) -> Result<RawLevels, PipelineError> {
    let first: RecordedFrame<PiSensor> = session
        .pi_frames(raw)?
        .next()
        .ok_or_else(|| missing(session, format!("`{raw}` has no frames")))??;
    let facts = first.properties;
    let black_dn = f64::from(facts.black_dn.iter().sum::<f32>() / 4.0);
    let full_dn = ((1_u32 << facts.bits.min(16)) - 1) as u16;
    Ok(RawLevels { black_dn, full_dn })
}

/// The map of the clocks that holds in the middle of the path.
fn pi_from_davis(
    session: &Session,
    path: &evrig_reconstruct::scene::HeadPath,
) -> Result<ClockMap<PiSensor, Davis>, PipelineError> {
    let none = || missing(session, "the Pi's clock is not known; run `evrig sync`".into());
    let clocks = read_clocks(session)?.ok_or_else(none)?;
    let middle_s = path.span_s().map_or(0.0, |[from, to]| (from + to) / 2.0);
    let middle = path.zero + evrig_core::time::Span::from_secs_f64(middle_s);
    let segment = clocks.davis_from_sensor.segment_at(middle).ok_or_else(none)?;
    Ok(segment.map.inverse())
}

fn write(directory: &Path, scene: &Scene) -> Result<(), PipelineError> {
    let facts = scene.parameters();
    let path = directory.join("scene.json");
    let io = |source| PipelineError::Io { path: path.clone(), source };
    let text = serde_json::to_string_pretty(&facts).map_err(|error| io(error.into()))?;
    std::fs::write(&path, text + "\n").map_err(io)?;
    let shape = [facts.grid.height as u64, facts.grid.width as u64];
    let map = &scene.reconstruction.map;
    array(&directory.join("map.npy"), &shape, map.values())?;
    array(&directory.join("map_error.npy"), &shape, map.errors())?;
    let table = scene.path_table();
    let shape = [(table.len() / PATH_COLUMNS) as u64, PATH_COLUMNS as u64];
    array(&directory.join("path.npy"), &shape, &table)
}

fn array<T: Element>(path: &Path, shape: &[u64], values: &[T]) -> Result<(), PipelineError> {
    let written = ArrayWriter::create(path, shape).and_then(|mut writer| {
        writer.extend(values)?;
        writer.finish()
    });
    Ok(written.map_err(SessionError::from)?)
}

pub(super) fn read_facts(directory: &Path) -> Result<SceneParameters, PipelineError> {
    let path = directory.join("scene.json");
    match std::fs::read_to_string(&path) {
        Ok(text) => read_result(path, &text),
        Err(source) => Err(PipelineError::Io { path, source }),
    }
}

/// The scene that the session holds; none before the stage ran.
///
/// # Errors
/// When its files cannot be read or do not fit together.
pub fn read_scene(session: &Session) -> Result<Option<Scene>, PipelineError> {
    let directory = session.layout().derived("scene", None);
    if read_stage(&directory).is_none() {
        return Ok(None);
    }
    let floats = |name: &str| -> Result<Vec<f64>, PipelineError> {
        let array = ArrayReader::open(&directory.join(name)).and_then(ArrayReader::read_all);
        match array.map_err(SessionError::from)?.fields.into_iter().next() {
            Some((_, Column::Float(values))) => Ok(values),
            _ => Err(broken(session, name)),
        }
    };
    let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect();
    let facts = read_facts(&directory)?;
    let (map, errors) = (single(floats("map.npy")?), single(floats("map_error.npy")?));
    let scene = Scene::from_parts(facts, map, errors, &floats("path.npy")?);
    scene.map(Some).ok_or_else(|| broken(session, "map.npy"))
}

fn broken(session: &Session, name: &str) -> PipelineError {
    missing(
        session,
        format!("derived/scene/{name} is not what the stage wrote; run `evrig scene --force`"),
    )
}
