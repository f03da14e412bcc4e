//! Tying the event camera to the survey.

use super::error::SceneError;
use super::head::DavisMount;
use super::register::{Registration, register};
use super::survey::Survey;
use super::tag_fit::{Before, MEASURED, OF_ITS_KIND, tie_by_tag};
use crate::roi::{Lens, Track};
use evrig_core::frame::Frame;
use evrig_core::time::{ClockMap, Davis, PiSensor};
use evrig_session::rig::Mount;

/// What is known of the event camera before its frames are held against the map.
#[derive(Debug, Clone, Copy)]
pub struct DavisKnown<'a> {
    /// Its lens.
    pub lens: Lens,
    /// Where both cameras sit.
    pub mount: Mount,
    /// The tag as its frames show it.
    pub track: &'a Track<Davis>,
    /// The clocks.
    pub pi_from_davis: ClockMap<PiSensor, Davis>,
    /// Whether lens and mount are those of this very rig; else they are its kind's, and clocks may be
    /// those of computers that no one compared.
    pub is_measured: bool,
}

/// Finds how the event camera sits beside the Pi camera, its lens's focal length and how late its
/// clock is: from the tag, then from the light in its frames. Where these show that the Pi's frames are
/// not linear in light, the survey is made so.
///
/// # Errors
/// When too few of its frames show the tag or fall on the map, or they fit no mount.
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
    // The survey's path counts the turn from the tag's first sighting, the rig's mount from nothing:
    // both cameras turn together, so that the mount is the same.
    let before = Before { stated, sigma: if known.is_measured { MEASURED } else { OF_ITS_KIND } };
    let by_tag = tie_by_tag(head, &survey.path, &before, known.pi_from_davis, sightings, plane)?;
    register(survey, by_tag, &before, frames)
}
