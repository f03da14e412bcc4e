//! The stage `track`: the path of the tag through a stream's frames, on the camera's own clock.

use super::{Freshness, PipelineError, clear, error::missing, fresh_record, inputs, read_json};
use evrig_core::frame::Frame;
use evrig_core::time::{Clock, Davis, PiSensor};
use evrig_reconstruct::roi::{SampleFormat, Track, TrackOptions, Tracker};
use evrig_session::rig::{CameraDescription, Rig};
use evrig_session::{
    Origin, RecordedFrame, Session, SessionError, StageRecord, StreamKind, StreamName, read_stage,
    write_stage,
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;

/// What to track.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackRequest {
    /// Name of the frame stream.
    pub stream: String,
    /// The rig to go by where the session has none of its own: name in the record, and description.
    pub rig: Option<(String, Rig)>,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// A track on the clock of its camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "clock", content = "track")]
pub enum AnyTrack {
    /// On the events' clock.
    #[serde(rename = "davis")]
    Davis(Track<Davis>),
    /// On the Pi's SensorTimestamp.
    #[serde(rename = "pi-sensor")]
    Pi(Track<PiSensor>),
}

/// What became of the frames.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TrackSummary {
    /// Family and number of the tag.
    pub tag: String,
    /// Frames shown.
    pub n_seen: u64,
    /// Frames whose sightings carry the path.
    pub n_used: u64,
    /// The others by reason, in words.
    pub lost: String,
    /// Stretches across which no path leads.
    pub n_gaps: u64,
    /// Their length together, seconds.
    pub gaps_s: f64,
    /// Distance of the seen corners from the path, root mean square, pixels.
    pub corner_rms_px: f64,
    /// Mean side of the image in the frames, pixels.
    pub picture_px: f64,
    /// Whose numbers of target and lens were used.
    pub rig: String,
}

/// A track and how it came about.
#[derive(Debug, Clone)]
pub struct Tracked {
    /// The track.
    pub track: AnyTrack,
    /// Its numbers.
    pub summary: TrackSummary,
    /// Whether it ran now.
    pub freshness: Freshness,
}

/// Names of the streams that have a track, in order.
#[must_use]
pub fn tracked(session: &Session) -> Vec<String> {
    let frames = session.manifest().streams.iter().filter(|s| s.kind == StreamKind::Frames);
    let has_track = |name: &&str| path(session, name).is_some_and(|path| path.exists());
    frames.map(|stream| stream.name.as_str()).filter(has_track).map(str::to_owned).collect()
}

fn path(session: &Session, stream: &str) -> Option<PathBuf> {
    let name = StreamName::new(stream).ok()?;
    Some(session.layout().derived("track", Some(&name)).join("track.json"))
}

/// Checksums of a track's files, as inputs of another stage.
pub(super) fn outputs(session: &Session, stream: &str) -> Result<inputs::Inputs, SessionError> {
    let name = StreamName::new(stream)?;
    let record = read_stage(&session.layout().derived("track", Some(&name)));
    let files = record.into_iter().flat_map(|record| record.outputs);
    Ok(files.map(|(file, sha256)| (format!("derived/track-{stream}/{file}"), sha256)).collect())
}

/// The track of a stream; none before the stage ran on it.
///
/// # Errors
/// When its file cannot be read.
pub fn read_track(session: &Session, stream: &str) -> Result<Option<AnyTrack>, PipelineError> {
    path(session, stream).map_or(Ok(None), read_json)
}

/// The summary of a track that the session holds.
#[must_use]
pub fn read_summary(session: &Session, stream: &str) -> Option<TrackSummary> {
    let name = StreamName::new(stream).ok()?;
    let record = read_stage(&session.layout().derived("track", Some(&name)))?;
    record.tally_as().ok()
}

/// Runs the stage, unless its result is fresh. `progress` takes frames done and in all.
///
/// # Errors
/// When there is no such stream, no frame shows the tag, or the disk refuses.
pub fn track(
    session: &Session,
    request: &TrackRequest,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Tracked, PipelineError> {
    let stream = request.stream.as_str();
    let name = StreamName::new(stream)?;
    let entry = session.stream(StreamKind::Frames, stream)?;
    let (whose, rig) = rig(session, request)?;
    let inputs = inputs::of_recorded(session, entry);
    let is_from_pi = session.is_from_pi(stream)?;
    let camera = if is_from_pi { &rig.pi.camera } else { &rig.davis.camera };
    let camera = fitted(camera, entry.size);
    let parameters = json!({
        "rig": whose,
        "target": format!("{:?}", rig.target),
        "lens": { "focal_px": evrig_reconstruct::roi::Lens::of(&camera).focal_px, "centre_px": camera.centre_px,
                  "distortion": camera.distortion },
    });
    let wanted = StageRecord::new("track", Some(stream), inputs, parameters);
    let directory = session.layout().derived("track", Some(&name));
    if !request.force
        && let Some(record) = fresh_record(&directory, &wanted)
        && let Some(track) = read_track(session, stream)?
    {
        let summary = record.tally_as().unwrap_or_default();
        return Ok(Tracked { track, summary, freshness: Freshness::Fresh });
    }
    let n = entry.count;
    let count = &mut |done| progress(done, n);
    let follow = Follow { session, stream, rig: &rig, camera: &camera };
    let track = if is_from_pi {
        AnyTrack::Pi(follow.run(session.pi_frames(stream)?, count)?)
    } else {
        AnyTrack::Davis(follow.run(session.davis_frames(stream)?, count)?)
    };
    let summary = track.summary(&whose);
    clear(&directory)?;
    let path = directory.join("track.json");
    let io = |source| PipelineError::Io { path: path.clone(), source };
    let text = serde_json::to_string(&track).map_err(|error| io(error.into()))?;
    std::fs::write(&path, text + "\n").map_err(io)?;
    write_stage(&directory, StageRecord { tally: json!(summary), ..wanted }, &["track.json"])?;
    Ok(Tracked { track, summary, freshness: Freshness::Ran })
}

/// The rig that a session was recorded with; else the one given; else, for the published layout,
/// the published geometry, which the bundled simulated rig has.
fn rig(session: &Session, request: &TrackRequest) -> Result<(String, Rig), PipelineError> {
    if let Some(rig) = session.rig()? {
        return Ok(("the session's own".into(), rig));
    }
    if let Some((name, rig)) = &request.rig {
        return Ok((name.clone(), rig.clone()));
    }
    if let Some(rig) = published(session)? {
        return Ok(("the published geometry".into(), rig));
    }
    let what = "nothing states its target and lens; name a rig file with --rig".to_owned();
    Err(missing(session, what))
}

/// The published geometry, for an import from the published layout.
pub(super) fn published(session: &Session) -> Result<Option<Rig>, PipelineError> {
    if !matches!(session.manifest().origin, Origin::Raw2Event { .. }) {
        return Ok(None);
    }
    Rig::simulated().map(Some).map_err(|error| missing(session, error.to_string()))
}

/// The camera with its axis in the middle of frames that are of another size than it states.
pub(super) fn fitted(
    camera: &CameraDescription,
    size: Option<evrig_core::geometry::Size>,
) -> CameraDescription {
    let mut camera = camera.clone();
    if let Some(size) = size.filter(|size| *size != camera.size) {
        camera.size = size;
        camera.centre_px = [f64::from(size.width) / 2.0, f64::from(size.height) / 2.0];
    }
    camera
}

/// One run over one stream.
struct Follow<'a> {
    session: &'a Session,
    stream: &'a str,
    rig: &'a Rig,
    camera: &'a CameraDescription,
}

impl Follow<'_> {
    fn run<C: Clock>(
        &self,
        images: impl Iterator<Item = Result<RecordedFrame<C>, SessionError>>,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Track<C>, PipelineError> {
        let wrong = |source| PipelineError::Track {
            session: self.session.root().to_owned(),
            stream: self.stream.to_owned(),
            source: Box::new(source),
        };
        let mut tracker: Option<Tracker<C>> = None;
        for image in images {
            let image = image?;
            let tracker = match &mut tracker {
                Some(tracker) => tracker,
                none => {
                    let options = TrackOptions::new(brightness_of(&image));
                    let made = Tracker::new(&self.rig.target, self.camera, options);
                    none.insert(made.map_err(wrong)?)
                }
            };
            // A lost frame is in the tally with its reason, and the next one may show the tag
            // again.
            let _ = tracker.see(&on_its_own_grid(image.frame));
            progress(image.number + 1);
        }
        let tracker = tracker.ok_or_else(|| wrong(evrig_reconstruct::roi::TrackError::NoFrames))?;
        tracker.finish().map_err(wrong)
    }
}

/// What the tracker must know of the samples.
fn brightness_of<C: Clock>(image: &RecordedFrame<C>) -> SampleFormat {
    match image.properties.bayer {
        Some(_) => {
            let black: f32 = image.properties.black_dn.iter().sum::<f32>() / 4.0;
            SampleFormat::Mosaic { black_level_dn: f64::from(black) }
        }
        None => SampleFormat::Brightness,
    }
}

/// The tracker's pixels are the frame's own, wherever on the sensor that lies.
fn on_its_own_grid<C: Clock>(frame: Frame<C>) -> Frame<C> {
    Frame { origin: [0, 0], ..frame }
}

impl AnyTrack {
    fn summary(&self, rig: &str) -> TrackSummary {
        match self {
            Self::Davis(track) => summary(track, rig),
            Self::Pi(track) => summary(track, rig),
        }
    }
}

fn summary<C: Clock>(track: &Track<C>, rig: &str) -> TrackSummary {
    let sides: Vec<f64> = track
        .knots
        .iter()
        .step_by(track.knots.len().div_ceil(200).max(1))
        .filter_map(|knot| track.at(knot.time).ok())
        .map(|view| view.roi().size.map(|side| side.0))
        .map(|[width, height]| (width * height).sqrt())
        .collect();
    TrackSummary {
        tag: track.tag.clone(),
        n_seen: track.tally.seen,
        n_used: track.tally.used,
        lost: track.tally.reasons(),
        n_gaps: track.gaps.len() as u64,
        gaps_s: track.gaps.iter().map(|gap| (gap.to - gap.from).as_secs_f64()).sum(),
        corner_rms_px: track.quality.corner_rms_px,
        picture_px: sides.iter().sum::<f64>() / sides.len().max(1) as f64,
        rig: rig.to_owned(),
    }
}
