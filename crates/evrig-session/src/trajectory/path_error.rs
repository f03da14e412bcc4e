//! Why a description makes no path.

use super::CurveError;
use crate::rig::Pose;
use evrig_core::time::Span;
use evrig_core::units::Millimetres;

/// Why a description makes no path on this rig.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PathError {
    /// The plane is edge-on to the camera, so that clockwise is undefined.
    #[error(
        "segment `{segment}`: its plane contains the DAVIS's optical axis, so that clockwise means \
         nothing; draw it in the plane `image`"
    )]
    EdgeOn {
        /// Its label.
        segment: String,
    },
    /// A way backwards that does not begin here.
    #[error(
        "segment `{segment}` runs `{of}` backwards, which must begin where that ended \
         ({expected}), but the tool is {away:.2} away ({got})"
    )]
    NotAtEnd {
        /// Its label.
        segment: String,
        /// What it reverses.
        of: String,
        /// Where that ended.
        expected: Pose,
        /// Where the tool is.
        got: Pose,
        /// How far it is from there.
        away: Millimetres,
    },
    /// A way backwards of what was not run.
    #[error("segment `{segment}` refers to `{of}`, which was left out before it")]
    NotRun {
        /// Its label.
        segment: String,
        /// What it refers to.
        of: String,
    },
    /// Points that make no curve.
    #[error("segment `{segment}`: {source}")]
    Curve {
        /// Its label.
        segment: String,
        /// What is wrong with them.
        source: CurveError,
    },
    /// An exposure that a frame has no time for.
    #[error(
        "segment `{segment}`: the {camera}'s exposure of {exposure} is longer than a frame's \
         {period}; lower exposure_scale, or frame_rate_hz in the rig"
    )]
    Exposure {
        /// Its label.
        segment: String,
        /// Which camera.
        camera: &'static str,
        /// The exposure that the segment asks for.
        exposure: Span,
        /// What there is time for.
        period: Span,
    },
    /// Repeats of repeats without end, or figures of too many points.
    #[error("segment `{segment}` is too much: a trajectory has at most {limit} {of_what}")]
    TooMuch {
        /// Its label.
        segment: String,
        /// What is bounded.
        of_what: &'static str,
        /// By how much.
        limit: usize,
    },
}
