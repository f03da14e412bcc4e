//! Delay of a stream relative to its stamps.
//!
//! The published recorder takes a raw frame with one request and the RGB frame with the next, and
//! stores one stamp for both: its RGB frames are exposed later than stamped. Both see one motion
//! through one lens, so that only the time between them is unknown.

use super::estimate::ClockEstimate;
use super::motion::{MotionOptions, TrackSample, motion};
use evrig_core::stats::Estimate;
use evrig_core::time::{Clock, ClockMap, PiSensor, Span, Stamp};
use serde::{Deserialize, Serialize};

/// A stream whose frames are exposed later than stamped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamDelay {
    /// Name of the stream.
    pub stream: String,
    /// The stream of the same camera with correct stamps.
    pub against: String,
    /// Delay of the exposure after the stamp, µs; None where the motion does not determine it.
    #[serde(alias = "late_us")]
    pub delay_us: Option<Estimate>,
    /// Why the delay is unknown and not corrected.
    pub refused: Option<String>,
}

/// Search range: a dozen frames of a slow camera,
const MAX_SEARCH: Span = Span::from_micros(200_000);
/// reduced in a short recording to this part of it, since both streams must overlap at every delay,
const SEARCH_DIVISOR: i64 = 10;
/// but at least three frames of a camera at 60 frames per second.
const MIN_SEARCH: Span = Span::from_micros(50_000);
/// Prior standard deviation of the roll between two streams of one camera, degrees.
const ROLL_SIGMA_DEG: f64 = 1e-3;

/// Delay of `own`, the track of `stream`, against the track of another stream of its camera.
#[must_use]
pub fn estimate_stream_delay(
    [stream, against]: [&str; 2],
    own: &[TrackSample<PiSensor>],
    reference: &[TrackSample<PiSensor>],
) -> StreamDelay {
    let zero = Stamp::from_nanos(0);
    let part = match reference {
        [first, .., last] => Span::from_nanos((last.at - first.at).as_nanos() / SEARCH_DIVISOR),
        _ => Span::ZERO,
    };
    let options = MotionOptions {
        search: part.clamp(MIN_SEARCH, MAX_SEARCH),
        fits_skew: false,
        roll_deg: Some(Estimate::normal(0.0, ROLL_SIGMA_DEG, 1)),
        ..MotionOptions::default()
    };
    let found = motion(reference, own, ClockMap::from_anchor(zero, zero), &options);
    let (delay_us, refused) = match found {
        Ok(found) => (Some(found.correction_us), None),
        Err(error) => (None, Some(error.to_string())),
    };
    StreamDelay { stream: stream.into(), against: against.into(), delay_us, refused }
}

impl<A: Clock, B: Clock> ClockEstimate<A, B> {
    /// The map with every result later by `by`.
    #[must_use]
    pub fn delayed(mut self, by: Span) -> Self {
        self.segments.iter_mut().for_each(|segment| segment.map.a0 = segment.map.a0 + by);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::units::Pixels;

    /// Where a circle that is run one way is seen, with some noise, when the light is `late_s`
    /// late.
    fn seen(late_s: f64, period_s: f64, turn_per_s: f64) -> Vec<TrackSample<PiSensor>> {
        seen_for(6.0, late_s, period_s, turn_per_s)
    }

    fn seen_for(
        seconds: f64,
        late_s: f64,
        period_s: f64,
        turn_per_s: f64,
    ) -> Vec<TrackSample<PiSensor>> {
        (0..(seconds / period_s) as u32)
            .map(|k| {
                let stamp_s = f64::from(k) * period_s;
                let phase = turn_per_s * std::f64::consts::TAU * (stamp_s + late_s);
                let noise = |salt: u32| {
                    let mixed = (k ^ salt).wrapping_mul(2_654_435_761).rotate_left(11);
                    0.05 * (f64::from(mixed.wrapping_mul(40_503) >> 16) / 65_536.0 - 0.5)
                };
                TrackSample {
                    at: Stamp::from_nanos(54_000_000_000_000 + (stamp_s * 1e9) as i64),
                    x: Pixels(300.0 + 60.0 * phase.cos() + noise(1)),
                    y: Pixels(200.0 + 60.0 * phase.sin() + noise(7)),
                    error: Pixels(0.02),
                }
            })
            .collect()
    }

    #[test]
    fn a_stream_that_is_a_frame_late_is_found_late_by_a_frame_even_on_one_circle() {
        let (raw, rgb) = (seen(0.0, 1.0 / 60.0, 0.4), seen(0.00833, 1.0 / 60.0, 0.4));
        let found = estimate_stream_delay(["rgb", "raw"], &rgb, &raw);
        let delay_us = found.delay_us.unwrap();
        assert!((delay_us.value - 8_330.0).abs() < 4.0 * delay_us.standard_error, "{delay_us:?}");
        assert!(delay_us.standard_error < 100.0, "{delay_us:?}");
    }

    #[test]
    fn a_second_of_motion_is_enough() {
        for (seconds, period_s) in [(1.0, 1.0 / 60.0), (0.6, 1.0 / 120.0)] {
            let (raw, rgb) =
                (seen_for(seconds, 0.0, period_s, 0.4), seen_for(seconds, 0.00833, period_s, 0.4));
            let delay_us = estimate_stream_delay(["rgb", "raw"], &rgb, &raw).delay_us.unwrap();
            assert!(
                (delay_us.value - 8_330.0).abs() < 4.0 * delay_us.standard_error,
                "{delay_us:?}"
            );
            assert!(delay_us.standard_error < 300.0, "{delay_us:?}");
        }
    }

    #[test]
    fn a_head_at_rest_determines_nothing_and_that_is_reported() {
        let still = seen(0.0, 1.0 / 60.0, 0.0);
        let found = estimate_stream_delay(["rgb", "raw"], &still, &still);
        assert!(found.delay_us.is_none() && found.refused.is_some(), "{found:?}");
    }
}
