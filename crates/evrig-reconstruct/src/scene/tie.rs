//! Alignment of the event camera to the reconstructed target.

use super::error::SceneError;
use super::head::DavisMount;
use super::register::{Registration, register};
use super::survey::Survey;
use super::tag_fit::{Before, MEASURED, OF_ITS_KIND, tie_by_tag};
use crate::roi::{Lens, Track};
use evrig_core::frame::Frame;
use evrig_core::time::{ClockMap, Davis, PiSensor};
use evrig_session::rig::Mount;

/// Known inputs of the alignment.
#[derive(Debug, Clone, Copy)]
pub struct DavisKnown<'a> {
    /// Lens of the event camera.
    pub lens: Lens,
    /// Mount of both cameras.
    pub mount: Mount,
    /// Track of the tag in its frames.
    pub track: &'a Track<Davis>,
    /// Clock map.
    pub pi_from_davis: ClockMap<PiSensor, Davis>,
    /// Whether lens, mount and clocks were measured on this rig; otherwise they are nominal for its
    /// type.
    pub is_measured: bool,
}

/// Estimates the pose of the event camera relative to the Pi camera, its focal length and its clock
/// lag: from the tag, then photometrically. Where the frames show that the Pi's frames are not
/// linear in light, the reconstruction is linearised.
///
/// # Errors
///
/// When too few frames show the tag or fall on the map, or they do not fit.
pub fn tie(
    survey: &mut Survey,
    known: &DavisKnown<'_>,
    frames: &[Frame<Davis>],
) -> Result<Registration, SceneError> {
    let first = tie_once(survey, known, frames)?;
    let Some(tone) = first.tone.filter(|tone| tone.curved().is_some()) else { return Ok(first) };
    let mut linear = survey.clone().raised(tone.power());
    let again = tie_once(&linear, known, frames)?;
    std::mem::swap(survey, &mut linear);
    Ok(Registration { tone: Some(tone), ..again })
}

fn tie_once(
    survey: &Survey,
    known: &DavisKnown<'_>,
    frames: &[Frame<Davis>],
) -> Result<Registration, SceneError> {
    let stated = DavisMount::stated(&known.mount, known.lens);
    let (sightings, plane) = (&known.track.sightings, &known.track.plane);
    let head = &survey.head;
    // The path counts wrist rotation from the tag's first detection. Both cameras rotate together,
    // so the mount does not change.
    let before = Before { stated, sigma: if known.is_measured { MEASURED } else { OF_ITS_KIND } };
    let by_tag = tie_by_tag(head, &survey.path, &before, known.pi_from_davis, sightings, plane)?;
    register(survey, by_tag, &before, frames)
}
