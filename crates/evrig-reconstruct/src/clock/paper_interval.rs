//! The paper's interval convergence, as its authors published it: the baseline.
//!
//! It takes the first frame whose interval to the next is nearest to equal on both clocks
//! and calls RealTime minus SensorTimestamp there the offset. What it finds is a frame
//! whose latency equals its neighbour's, a draw from the square of the latency's density:
//! more frames never bring it nearer to the smallest latency.
//!
//! Kept on purpose, since a baseline must err as the original does:
//! - times are microseconds, SensorTimestamp a double, RealTime whole microseconds; given
//!   nanoseconds for SensorTimestamp (as one recorder stores it) all ratios are near 1000
//!   and the longest RealTime interval wins ([`PaperUnit::Nanoseconds`]);
//! - an interval of 0/0 is NaN, and NaN wins over every number;
//! - of equal ratios, frequent among whole microseconds, the first wins;
//! - the offset is that of the earlier frame of the two, rounded towards zero.
//!
//! It takes pairs unchecked, as the original does.

use super::error::ClockError;
use super::estimate::{
    ClockEstimate, Diagnostics, Method, MinimumLatency, PaperChoice, SegmentStart,
};
use super::input::{FramePair, PairTally};
use super::trace::{OffsetLine, PairTrace};
use evrig_core::time::{Clock, ClockMap, Span, Stamp};

/// The unit in which SensorTimestamp reaches the published function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PaperUnit {
    /// As the function needs it.
    #[default]
    Microseconds,
    /// As one of the paper's recorders stores it; reproduces what then goes wrong.
    Nanoseconds,
}

/// The published estimate. It claims no error, so none is given.
///
/// # Errors
/// Fewer than two pairs.
pub fn paper_interval<A: Clock, B: Clock>(
    pairs: &[FramePair<A, B>],
    unit: PaperUnit,
) -> Result<ClockEstimate<A, B>, ClockError> {
    if pairs.len() < 2 {
        return Err(ClockError::TooFewFrames { found: pairs.len(), needed: 2 });
    }
    let unit_ns = match unit {
        PaperUnit::Microseconds => 1_000.0,
        PaperUnit::Nanoseconds => 1.0,
    };
    let sensor: Vec<f64> =
        pairs.iter().map(|pair| pair.sensor.as_nanos() as f64 / unit_ns).collect();
    let real: Vec<i64> = pairs.iter().map(|pair| pair.real.as_micros()).collect();
    let choice = choose(&sensor, &real);
    let frame = choice.frame as usize;
    // Truncation towards zero, as `int()` does; the cast saturates where Python's would not.
    let offset = (real[frame] as f64 - sensor[frame]) as i64;
    let map = ClockMap {
        a0: Stamp::from_micros((sensor[frame] as i64).saturating_add(offset)),
        b0: Stamp::from_nanos((sensor[frame] as i64).saturating_mul(unit_ns as i64)),
        skew: 0.0,
    };
    Ok(whole_recording(Method::PaperInterval, pairs, map, choice))
}

fn choose(sensor: &[f64], real: &[i64]) -> PaperChoice {
    let distance = |at: usize| {
        let ratio = (sensor[at + 1] - sensor[at]) / (real[at + 1] - real[at]) as f64;
        (ratio, (ratio - 1.0).abs())
    };
    let n = sensor.len() - 1;
    let n_undefined = (0..n).filter(|&at| distance(at).1.is_nan()).count() as u64;
    let undefined = (0..n).find(|&at| distance(at).1.is_nan());
    let least = (0..n).min_by(|&a, &b| distance(a).1.total_cmp(&distance(b).1));
    let frame = undefined.or(least).unwrap_or(0);
    let n_ties = (0..n).filter(|&at| distance(at).1 == distance(frame).1).count() as u64;
    let ratio = distance(frame).0;
    PaperChoice {
        frame: frame as u64,
        ratio: ratio.is_finite().then_some(ratio),
        n_ties: n_ties.saturating_sub(1),
        n_undefined,
    }
}

/// One constant offset over all pairs, without an error of its own.
pub(super) fn whole_recording<A: Clock, B: Clock>(
    method: Method,
    pairs: &[FramePair<A, B>],
    map: ClockMap<A, B>,
    choice: PaperChoice,
) -> ClockEstimate<A, B> {
    let trace = PairTrace::new(pairs);
    let all = 0..pairs.len();
    let mut segment =
        trace.segment(&all, SegmentStart::Beginning, OffsetLine::constant(0.0), Span::ZERO);
    segment.map = map;
    let first = pairs[0];
    let offset_us = (map.map(first.sensor) - first.real).as_nanos() as f64 * 1e-3;
    let diagnostics = Diagnostics { paper: Some(choice), ..trace.diagnostics(|_| offset_us) };
    let n = pairs.len() as u64;
    ClockEstimate {
        method,
        segments: vec![segment],
        minimum_latency: MinimumLatency::Unknown,
        doubtful: Vec::new(),
        tally: PairTally { n_seen: n, n_kept: n, ..PairTally::default() },
        diagnostics,
    }
}
