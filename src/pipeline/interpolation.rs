//! Interpolation between a stream's frames: none, per pixel, or along the motion of the target
//! plane.

use super::PipelineError;
use super::conditions::Conditions;
use super::error::missing;
use super::luminance::{LuminanceStream, luminance};
use super::sync::read_clocks;
use super::track::{AnyTrack, read_track};
use evrig_core::geometry::Homography;
use evrig_core::time::{Clock, Davis, PiSensor, Stamp};
use evrig_generate::input::{Colour, FramePreparation};
use evrig_generate::{FrameUpsampling, Interpolator, PlaneInterpolator, PlanePath};
use evrig_reconstruct::clock::ClockEstimate;
use evrig_reconstruct::roi::{Lens, Track};
use evrig_session::Session;

/// Interpolation step in the target plane by default, µs.
const DEFAULT_PLANE_STEP_US: u32 = 1_000;

/// The track of a camera on the events' clock.
struct TrackedPlane<C: Clock> {
    track: Track<C>,
    /// From the events' clock to the camera's; none where they are one.
    clock: Option<Box<ClockEstimate<Davis, PiSensor>>>,
    to_track_clock: fn(&Self, Stamp<Davis>) -> Option<Stamp<C>>,
}

impl<C: Clock> PlanePath for TrackedPlane<C> {
    fn pixel_from_plane(&self, t_us: f64) -> Option<Homography> {
        let whole = t_us.floor();
        let nanos = (whole as i64).checked_mul(1_000)? + ((t_us - whole) * 1e3) as i64;
        let at = (self.to_track_clock)(self, Stamp::from_nanos(nanos))?;
        Some(*self.track.at(at).ok()?.homography())
    }

    fn distort(&self, ideal: [f64; 2]) -> [f64; 2] {
        self.lens().distort(ideal)
    }

    fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        self.lens().undistort(pixel)
    }

    fn has_distortion(&self) -> bool {
        self.lens().distortion != [0.0; 5]
    }
}

impl<C: Clock> TrackedPlane<C> {
    const fn lens(&self) -> &Lens {
        &self.track.lens
    }
}

/// The motion of the target plane in a stream's frames, on the events' clock.
///
/// # Errors
/// When the tag was not tracked in them, or their clock is not known.
pub(super) fn plane_path(
    session: &Session,
    stream: &str,
) -> Result<Box<dyn PlanePath>, PipelineError> {
    let none = || {
        let what = format!("`{stream}` has no track of the target; run `evrig track` first");
        missing(session, what)
    };
    match read_track(session, stream)?.ok_or_else(none)? {
        AnyTrack::Davis(track) => {
            let to_track_clock = |_: &TrackedPlane<Davis>, at| Some(at);
            Ok(Box::new(TrackedPlane { track, clock: None, to_track_clock }))
        }
        AnyTrack::Pi(track) => {
            let clocks = read_clocks(session)?.ok_or_else(|| {
                missing(session, format!("`{stream}` is on the Pi's clock; run `evrig sync` first"))
            })?;
            let clock = Some(Box::new(clocks.davis_from(stream)));
            let to_track_clock =
                |own: &TrackedPlane<PiSensor>, at| own.clock.as_ref()?.inverse_map(at);
            Ok(Box::new(TrackedPlane { track, clock, to_track_clock }))
        }
    }
}

/// The interpolator between the frames of a stream.
///
/// # Errors
/// A step out of range; no track where the target plane is asked for.
pub(super) fn between(
    session: &Session,
    stream: &str,
    conditions: &Conditions,
) -> Result<FrameUpsampling, PipelineError> {
    if conditions.in_plane {
        let finest_us = conditions.interpolate_us.unwrap_or(DEFAULT_PLANE_STEP_US);
        let path = plane_path(session, stream)?;
        return Ok(FrameUpsampling::Plane(Box::new(PlaneInterpolator::new(finest_us, path)?)));
    }
    Ok(match conditions.interpolate_us {
        Some(step_us) => FrameUpsampling::Pixels(Interpolator::new(step_us)?),
        None => FrameUpsampling::Nothing,
    })
}

/// The luminance of a stream under the given conditions. In the target plane a mosaic becomes luma,
/// because moving content changes colour from pixel to pixel.
///
/// # Errors
/// As [`luminance`].
pub(super) fn prepared_luminance(
    session: &Session,
    stream: &str,
    conditions: &Conditions,
) -> Result<LuminanceStream, PipelineError> {
    let Conditions { preparation, in_plane, .. } = *conditions;
    let is_moved = in_plane && preparation.colour == Colour::Mosaic;
    let colour = if is_moved { Colour::Luma } else { preparation.colour };
    Ok(luminance(session, stream)?.prepared(FramePreparation { colour, ..preparation }))
}
