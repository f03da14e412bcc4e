//! The log-intensity signal that a diagnosis starts from.

use super::{clock_tie, departures};
use crate::pipeline::error::missing;
use crate::pipeline::luminance::aps_starts;
use crate::pipeline::scene_source::{self, SCENE};
use crate::pipeline::sync::read_clocks;
use crate::pipeline::{PipelineError, default_light, inputs, read_scene};
use evrig_analysis::diagnose::SessionFacts;
use evrig_core::drive::Drive;
use evrig_reconstruct::scene::{FramesDrive, Scene};
use evrig_session::{Session, StreamKind, read_stage};
use serde::{Deserialize, Serialize};

/// Source of the signal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Baseline {
    /// The map of the target and the head's path over it.
    Scene,
    /// A frame stream on the events' pixel grid, interpolated along optical flow.
    Motion(String),
    /// The same, interpolated linearly.
    Frames(String),
}

/// A kind of source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaselineKind {
    /// See [`Baseline::Scene`].
    Scene,
    /// See [`Baseline::Motion`].
    Motion,
    /// See [`Baseline::Frames`].
    Frames,
}

/// The scene if the session has one, else the frames that a generation would use.
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

impl Baseline {
    /// Of a kind, or the session's default; from a frame stream, or those that a generation would
    /// use. `None` where the session has neither scene nor frames.
    #[must_use]
    pub fn chosen(
        session: &Session,
        kind: Option<BaselineKind>,
        from: Option<&str>,
    ) -> Option<Self> {
        let frames = || from.or_else(|| default_light(session)).map(str::to_owned);
        match (kind, from) {
            (Some(BaselineKind::Scene), _) => Some(Self::Scene),
            (Some(BaselineKind::Motion), _) | (None, Some(_)) => frames().map(Self::Motion),
            (Some(BaselineKind::Frames), _) => frames().map(Self::Frames),
            (None, None) => default_baseline(session),
        }
    }

    /// Name of the frame stream, or `scene`.
    #[must_use]
    pub fn from(&self) -> &str {
        match self {
            Self::Scene => SCENE,
            Self::Motion(light) | Self::Frames(light) => light,
        }
    }

    /// Checksums of its files.
    pub(in crate::pipeline) fn inputs(
        &self,
        session: &Session,
    ) -> Result<inputs::Inputs, PipelineError> {
        match self {
            Self::Scene => Ok(scene_source::inputs_of(session)),
            Self::Motion(light) | Self::Frames(light) => {
                let entry = session.stream(StreamKind::Frames, light)?;
                Ok(inputs::of_recorded(session, entry))
            }
        }
    }

    /// Reads the signal.
    pub(in crate::pipeline) fn light(
        &self,
        session: &Session,
    ) -> Result<BaselineLight, PipelineError> {
        match self {
            Self::Scene => of_scene(session),
            Self::Frames(light) => {
                let (drive, facts) = of_frames(session, light)?;
                Ok(BaselineLight { drive: Box::new(drive), facts, scene: None })
            }
            Self::Motion(light) => {
                let (mut drive, mut facts) = of_frames(session, light)?;
                facts.is_motion_compensated = !facts.is_light_dense();
                if facts.is_motion_compensated {
                    drive = drive.without_saturated().motion_compensated().denoised();
                }
                Ok(BaselineLight { drive: Box::new(drive), facts, scene: None })
            }
        }
    }
}

/// A signal with what the session states.
pub(in crate::pipeline) struct BaselineLight {
    /// The signal.
    pub(in crate::pipeline) drive: Box<dyn Drive>,
    /// What the session states.
    pub(in crate::pipeline) facts: SessionFacts,
    /// The scene, if it is the source.
    pub(in crate::pipeline) scene: Option<Scene>,
}

/// Bound on the clock error of the camera's own frames: half an exposure.
const SAME_CAMERA_BOUND_US: f64 = 1_500.0;

/// Bound on the error of the scene's clock tie: half an exposure of the DAVIS, and noise makes
/// crossings early.
const TIED_BOUND_US: f64 = 1_500.0;

/// Bound on the delay of events against the stated clocks: noise makes crossings early.
const STATED_BOUND_US: f64 = 800.0;

fn of_scene(session: &Session) -> Result<BaselineLight, PipelineError> {
    let rig = session.rig()?;
    let none = || missing(session, "it has no scene; run `evrig scene` first".into());
    let scene = read_scene(session)?.ok_or_else(none)?;
    let drive = scene.drive();
    let row_delay_us = rig.as_ref().map_or(0.0, |rig| departures::row_delay_us(&scene, rig));
    let clocks = read_clocks(session)?;
    let clocks = clocks.and_then(|clocks| clock_tie::clock_tie(&scene, &clocks, row_delay_us));
    let facts = SessionFacts {
        from_scene: true,
        is_motion_compensated: false,
        aps_us: aps_starts(session)?,
        frame_us: 0.0,
        white_dn: drive.white_dn(),
        light_per_pedestal: light_per_pedestal(&scene),
        offset_bound_us: if clocks.is_some() { STATED_BOUND_US } else { TIED_BOUND_US },
        clock_tie: clocks,
        pixel_mm: Some(scene.registration.pixel_mm),
        testable_from_frames: departures::testable_from_frames(&scene, rig.as_ref()),
        stamp_step_us: None,
    };
    Ok(BaselineLight { drive: Box::new(drive), facts, scene: Some(scene) })
}

/// Map units per digital unit of pedestal: every colour site is scaled to the brightest and
/// weighted by its gain.
fn light_per_pedestal(scene: &Scene) -> f64 {
    4.0 / scene.reconstruction.site_gains.iter().sum::<f64>()
}

/// The drive from frames of the event camera itself.
fn of_frames(session: &Session, light: &str) -> Result<(FramesDrive, SessionFacts), PipelineError> {
    let size =
        session.size().ok_or_else(|| missing(session, "no stream states its pixel grid".into()))?;
    let mut unreadable = None;
    let frames = session.luminance(light)?;
    let frames = frames.map_while(|frame| frame.map_err(|error| unreadable = Some(error)).ok());
    let drive = FramesDrive::new(frames, 0.0, 0.0);
    if let Some(error) = unreadable {
        return Err(error.into());
    }
    let drive = drive.map_err(|error| missing(session, format!("`{light}`: {error}")))?;
    if drive.size() != size {
        let what = format!("`{light}` does not lie on the events' pixel grid of {size}");
        return Err(missing(session, what));
    }
    let times = drive.times_us();
    let own = aps_starts(session)?;
    let facts = SessionFacts {
        from_scene: false,
        is_motion_compensated: false,
        aps_us: if own.is_empty() { times.to_vec() } else { own },
        frame_us: (times[times.len() - 1] - times[0]) as f64 / (times.len() - 1).max(1) as f64,
        white_dn: drive.white_dn(),
        light_per_pedestal: 1.0,
        offset_bound_us: SAME_CAMERA_BOUND_US,
        clock_tie: None,
        pixel_mm: None,
        testable_from_frames: Vec::new(),
        stamp_step_us: None,
    };
    Ok((drive, facts))
}
