//! What is put between a stream's frames: nothing, pixels that fade, or the print that moves on.

use super::generate::Conditions;
use super::sync::{missing, read_clocks};
use super::track::{AnyTrack, read_track};
use super::{Light, PipelineError, light};
use evrig_core::geometry::Homography;
use evrig_core::time::{Clock, Davis, PiSensor, Stamp};
use evrig_generate::input::{Colour, FramePreparation};
use evrig_generate::{FrameUpsampling, Interpolator, PlaneInterpolator, PlanePath};
use evrig_reconstruct::clock::ClockEstimate;
use evrig_reconstruct::roi::{Lens, Track};
use evrig_session::Session;

/// How close frames are put in the target plane when nothing else is said, µs.
const FINEST_US: u32 = 1_000;

/// The track of a camera on the events' clock.
struct OnTrack<C: Clock> {
    track: Track<C>,
    /// From the events' clock to the camera's; none where they are one.
    clock: Option<Box<ClockEstimate<Davis, PiSensor>>>,
    on_its_clock: fn(&Self, Stamp<Davis>) -> Option<Stamp<C>>,
}

impl<C: Clock> PlanePath for OnTrack<C> {
    fn pixel_from_plane(&self, t_us: f64) -> Option<Homography> {
        let whole = t_us.floor();
        let nanos = (whole as i64).checked_mul(1_000)? + ((t_us - whole) * 1e3) as i64;
        let at = (self.on_its_clock)(self, Stamp::from_nanos(nanos))?;
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

impl<C: Clock> OnTrack<C> {
    const fn lens(&self) -> &Lens {
        &self.track.lens
    }
}

/// The way of the print through the pictures of a stream, on the events' clock.
///
/// # Errors
/// When the tag was not tracked in them, or their clock is not known.
pub(super) fn plane_path(
    session: &Session,
    stream: &str,
) -> Result<Box<dyn PlanePath>, PipelineError> {
    let none = || {
        let what = format!("`{stream}` has no track of the print; run `evrig track` first");
        missing(session, what)
    };
    match read_track(session, stream)?.ok_or_else(none)? {
        AnyTrack::Davis(track) => {
            let on_its_clock = |_: &OnTrack<Davis>, at| Some(at);
            Ok(Box::new(OnTrack { track, clock: None, on_its_clock }))
        }
        AnyTrack::Pi(track) => {
            let clocks = read_clocks(session)?.ok_or_else(|| {
                missing(session, format!("`{stream}` is on the Pi's clock; run `evrig sync` first"))
            })?;
            let clock = Some(Box::new(clocks.davis_from(stream)));
            let on_its_clock = |own: &OnTrack<PiSensor>, at| own.clock.as_ref()?.inverse_map(at);
            Ok(Box::new(OnTrack { track, clock, on_its_clock }))
        }
    }
}

/// What the conditions put between the frames of a stream.
///
/// # Errors
/// A step out of range; no track where the target plane is asked for.
pub(super) fn between(
    session: &Session,
    stream: &str,
    conditions: &Conditions,
) -> Result<FrameUpsampling, PipelineError> {
    if conditions.in_plane {
        let finest_us = conditions.interpolate_us.unwrap_or(FINEST_US);
        let path = plane_path(session, stream)?;
        return Ok(FrameUpsampling::Plane(Box::new(PlaneInterpolator::new(finest_us, path)?)));
    }
    Ok(match conditions.interpolate_us {
        Some(step_us) => FrameUpsampling::Pixels(Interpolator::new(step_us)?),
        None => FrameUpsampling::Nothing,
    })
}

/// The light of a stream as the conditions want it. In the target plane a mosaic is taken as luma:
/// what moves through it changes colour from pixel to pixel.
///
/// # Errors
/// As [`light::light`].
pub(super) fn light_under(
    session: &Session,
    stream: &str,
    conditions: &Conditions,
) -> Result<Light, PipelineError> {
    let Conditions { preparation, in_plane, .. } = *conditions;
    let is_moved = in_plane && preparation.colour == Colour::Mosaic;
    let colour = if is_moved { Colour::Luma } else { preparation.colour };
    Ok(light::light(session, stream)?.prepared(FramePreparation { colour, ..preparation }))
}
