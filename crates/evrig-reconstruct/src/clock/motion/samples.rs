//! Samples of the two tracks, and the options of the fit.

use crate::clock::order::longest_increasing;
use evrig_core::stats::Estimate;
use evrig_core::time::{Clock, Span, Stamp};
use evrig_core::units::Pixels;

/// Position of the tag in a camera, with the time corrected for row and exposure
/// ([`crate::clock::RowTiming::middle`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackSample<C: Clock> {
    /// Mid-exposure of the position's row.
    pub at: Stamp<C>,
    /// Column.
    pub x: Pixels,
    /// Row.
    pub y: Pixels,
    /// Standard error of each coordinate.
    pub error: Pixels,
}

/// Options of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionOptions {
    /// Half width of the search around the initial map.
    pub search: Span,
    /// Whether the rate is fitted; over a few seconds it is hardly determined.
    pub fits_skew: bool,
    /// Measured roll of the other camera against the reference, degrees.
    pub roll_deg: Option<Estimate>,
    /// Largest accepted factor by which unknown geometry inflates the error.
    pub max_ratio: f64,
    /// Half width of the systematic error.
    pub systematic: Span,
}

impl Default for MotionOptions {
    fn default() -> Self {
        Self {
            search: Span::from_micros(500_000),
            fits_skew: true,
            roll_deg: None,
            max_ratio: 10.0,
            systematic: Span::ZERO,
        }
    }
}

/// A sample as numbers: seconds since the reference's first, pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrackPoint {
    pub(super) t_s: f64,
    pub(super) p: [f64; 2],
    pub(super) error: f64,
}

pub(super) fn points<C: Clock>(
    samples: &[TrackSample<C>],
    since: impl Fn(Stamp<C>) -> Span,
) -> Vec<TrackPoint> {
    let is_sound = |sample: &&TrackSample<C>| {
        let error = sample.error.value();
        sample.x.value().is_finite()
            && sample.y.value().is_finite()
            && error.is_finite()
            && error > 0.0
    };
    let sound: Vec<_> = samples.iter().filter(is_sound).collect();
    let stamps: Vec<i64> = sound.iter().map(|sample| sample.at.as_nanos()).collect();
    let in_order = longest_increasing(&stamps);
    let kept = sound.into_iter().zip(in_order).filter(|(_, is_kept)| *is_kept);
    kept.map(|(sample, _)| TrackPoint {
        t_s: since(sample.at).as_secs_f64(),
        p: [sample.x.value(), sample.y.value()],
        error: sample.error.value(),
    })
    .collect()
}
