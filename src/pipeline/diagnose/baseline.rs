//! The light of the event pixels that a diagnosis starts from, and what is known of it.

use super::{stated, tied};
use crate::pipeline::error::missing;
use crate::pipeline::luminance::aps_starts;
use crate::pipeline::scene_source::{self, SCENE};
use crate::pipeline::sync::read_clocks;
use crate::pipeline::{PipelineError, default_light, inputs, read_scene};
use evrig_analysis::diagnose::Facts;
use evrig_core::drive::Drive;
use evrig_reconstruct::scene::{FramesDrive, Scene};
use evrig_session::{Session, StreamKind, read_stage};
use serde::{Deserialize, Serialize};

/// What the light of the event pixels comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
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

impl Baseline {
    /// Name of the light: that of the frame stream, or `scene`.
    #[must_use]
    pub fn from(&self) -> &str {
        match self {
            Self::Scene => SCENE,
            Self::Motion(light) | Self::Frames(light) => light,
        }
    }

    /// Checksums of the files behind it.
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

    /// Reads it.
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
                facts.is_led = !facts.is_light_dense();
                if facts.is_led {
                    drive = drive.without_clipped().led_by_motion().steadied();
                }
                Ok(BaselineLight { drive: Box::new(drive), facts, scene: None })
            }
        }
    }
}

/// A light that was read.
pub(in crate::pipeline) struct BaselineLight {
    /// The light at any time.
    pub(in crate::pipeline) drive: Box<dyn Drive>,
    /// What is known of it.
    pub(in crate::pipeline) facts: Facts,
    /// The scene that it is of.
    pub(in crate::pipeline) scene: Option<Scene>,
}

/// By how much the clock of the camera's own frames may be off against its events: half an
/// exposure that a writer put elsewhere.
const SAME_CAMERA_US: f64 = 1_500.0;

/// By how much the scene's tie of the clocks may be off: the DAVIS's frames and events differ by
/// half an exposure at worst, and noise makes crossings early.
const TIED_US: f64 = 1_500.0;

/// By how much events may come beside what the clocks themselves state: noise makes crossings early.
const STATED_US: f64 = 800.0;

fn of_scene(session: &Session) -> Result<BaselineLight, PipelineError> {
    let rig = session.rig()?;
    let none = || missing(session, "it holds no scene; run `evrig scene` first".into());
    let scene = read_scene(session)?.ok_or_else(none)?;
    let drive = scene.drive();
    let later_us = rig.as_ref().map_or(0.0, |rig| stated::later_us(&scene, rig));
    let clocks = read_clocks(session)?;
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
    Ok(BaselineLight { drive: Box::new(drive), facts, scene: Some(scene) })
}

/// What a pedestal of one digital unit adds to the map, in which each place of the mosaic is scaled to
/// the brightest and weighs by its gain.
fn light_per_pedestal(scene: &Scene) -> f64 {
    4.0 / scene.survey.site_gains.iter().sum::<f64>()
}

/// The drive from frames of the event camera itself.
fn of_frames(session: &Session, light: &str) -> Result<(FramesDrive, Facts), PipelineError> {
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
