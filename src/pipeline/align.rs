//! Tracks, clocks and scene, in the order in which they need each other.
//!
//! Tracks come first: their common motion gives the most precise clock offset; the scene needs
//! both.

use super::PipelineError;
use super::scene::{SceneMade, scene};
use super::streams::{frame_streams, pi_streams};
use super::sync::{Synced, sync};
use super::track::{TrackRequest, Tracked, track};
use evrig_session::{Origin, Session};
use rayon::prelude::*;

/// A stream's track, or why it has none.
pub type TrackOutcome = (TrackRequest, Result<Tracked, PipelineError>);

/// What became of each stage. No stage's failure keeps another from being tried.
#[derive(Debug)]
pub struct Aligned {
    /// Every stream's track, or why none was looked for.
    pub tracks: Result<Vec<TrackOutcome>, &'static str>,
    /// The clocks; none where the Pi has no frames.
    pub clocks: Option<Result<Synced, PipelineError>>,
    /// The scene.
    pub scene: Result<SceneMade, PipelineError>,
}

/// How far it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlignProgress {
    /// One more frame was searched for the tag.
    Tracked,
    /// Frames added to the scene, and in all.
    Mapped(u64, u64),
}

/// Runs the three stages, those that are fresh not again.
pub fn align(session: &Session, force: bool, progress: &(dyn Fn(AlignProgress) + Sync)) -> Aligned {
    let tracks = requests(session, force)
        .map(|requests| track_all(session, &requests, &|| progress(AlignProgress::Tracked)));
    let clocks = (!pi_streams(session).is_empty()).then(|| sync(session, force));
    let mapped = &mut |done, all| progress(AlignProgress::Mapped(done, all));
    Aligned { tracks, clocks, scene: scene(session, force, mapped) }
}

fn requests(session: &Session, force: bool) -> Result<Vec<TrackRequest>, &'static str> {
    let origin = &session.manifest().origin;
    let states_target =
        session.manifest().recording.is_some() || matches!(origin, Origin::Raw2Event { .. });
    let streams = frame_streams(session);
    if streams.is_empty() {
        Err("the session has no frames")
    } else if !states_target {
        Err("nothing states the target; `evrig track --rig RIG` names it")
    } else {
        let request = |stream| TrackRequest { stream, rig: None, force };
        Ok(streams.into_iter().map(request).collect())
    }
}

/// Tracks several streams at once; `on_frame` is called for every frame.
#[must_use]
pub fn track_all(
    session: &Session,
    requests: &[TrackRequest],
    on_frame: &(dyn Fn() + Sync),
) -> Vec<TrackOutcome> {
    let one =
        |request: &TrackRequest| (request.clone(), track(session, request, &mut |_, _| on_frame()));
    requests.par_iter().map(one).collect()
}
