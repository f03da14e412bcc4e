//! Alignment of the event camera to the reconstructed target.

use super::error::SceneError;
use super::head::DavisMount;
use super::reconstruction::Reconstruction;
use super::registration::{Registration, register};
use super::tag_alignment::{AlignmentPrior, MEASURED_SIGMA, NOMINAL_SIGMA, align_by_tag};
use crate::roi::{Lens, Track};
use evrig_core::frame::Frame;
use evrig_core::time::{ClockMap, Davis, PiSensor};
use evrig_session::rig::Mount;

/// Known inputs of the alignment.
#[derive(Debug, Clone, Copy)]
pub struct DavisInputs<'a> {
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
/// When too few frames show the tag or fall on the map, or they do not fit.
pub fn align_davis(
    target: &mut Reconstruction,
    known: &DavisInputs<'_>,
    frames: &[Frame<Davis>],
) -> Result<Registration, SceneError> {
    let first = align_once(target, known, frames)?;
    let Some(tone) = first.tone.filter(|tone| tone.nonlinear_sigmas().is_some()) else {
        return Ok(first);
    };
    let mut linear = target.clone().with_power(tone.power());
    let again = align_once(&linear, known, frames)?;
    std::mem::swap(target, &mut linear);
    Ok(Registration { tone: Some(tone), ..again })
}

fn align_once(
    target: &Reconstruction,
    known: &DavisInputs<'_>,
    frames: &[Frame<Davis>],
) -> Result<Registration, SceneError> {
    let stated = DavisMount::stated(&known.mount, known.lens);
    let (detections, plane) = (&known.track.detections, &known.track.plane);
    let head = &target.head;
    // The path counts wrist rotation from the tag's first detection. Both cameras rotate together,
    // so the mount does not change.
    let prior = AlignmentPrior {
        stated,
        sigma: if known.is_measured { MEASURED_SIGMA } else { NOMINAL_SIGMA },
    };
    let by_tag = align_by_tag(head, &target.path, &prior, known.pi_from_davis, detections, plane)?;
    register(target, by_tag, &prior, frames)
}
