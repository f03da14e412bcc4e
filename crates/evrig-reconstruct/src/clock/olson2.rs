//! Minimum latency within a drift bound, forwards and backwards in time.
//!
//! Olson (IROS 2010): the estimate rises at most at the clocks' relative drift and falls to every
//! smaller difference. In both directions it is the lower envelope of cones of slope `drift` on the
//! points. It needs only the bound and gives no interval.

use super::error::ClockError;
use super::estimate::{ClockEstimate, Method, MinimumLatency, SegmentStart};
use super::input::FramePairs;
use super::trace::{OffsetLine, PairTrace};
use evrig_core::time::Clock;

/// The envelope of cones; `drift_ppm` bounds the difference of the rates (50 for two crystals).
///
/// # Errors
/// None for checked pairs; the signature is that of every method.
pub fn olson2<A: Clock, B: Clock>(
    pairs: &FramePairs<A, B>,
    drift_ppm: f64,
    latency: MinimumLatency,
) -> Result<ClockEstimate<A, B>, ClockError> {
    let trace = PairTrace::new(pairs.pairs());
    let floor = floor(&trace.x_s, &trace.y_us, drift_ppm);
    let corners = corners(&trace.x_s, &trace.y_us, &floor, drift_ppm);
    let n = trace.x_s.len();
    let mut segments = Vec::with_capacity(corners.len());
    let mut begin = 0;
    for (number, pair) in corners.windows(2).enumerate() {
        let is_last = number + 2 == corners.len();
        let within = trace.x_s[begin..].partition_point(|x| *x < pair[1][0]);
        let end = if is_last { n } else { begin + within };
        if begin == end {
            continue;
        }
        let start = if begin == 0 { SegmentStart::Beginning } else { SegmentStart::Bend };
        let line = OffsetLine::through(pair[0], pair[1]);
        segments.push(trace.segment(&(begin..end), start, line, latency.subtracted()));
        begin = end;
    }
    Ok(ClockEstimate {
        method: Method::Olson2,
        segments,
        minimum_latency: latency,
        doubtful: Vec::new(),
        tally: pairs.tally(),
        diagnostics: trace.diagnostics(|index| floor[index]),
    })
}

fn floor(x_s: &[f64], y_us: &[f64], drift_ppm: f64) -> Vec<f64> {
    let mut floor = y_us.to_vec();
    for at in 1..floor.len() {
        floor[at] = floor[at].min(floor[at - 1] + drift_ppm * (x_s[at] - x_s[at - 1]));
    }
    for at in (1..floor.len()).rev() {
        floor[at - 1] = floor[at - 1].min(floor[at] + drift_ppm * (x_s[at] - x_s[at - 1]));
    }
    floor
}

/// Vertices of the envelope: contact points, intersections of cones, and both ends.
fn corners(x_s: &[f64], y_us: &[f64], floor: &[f64], drift_ppm: f64) -> Vec<[f64; 2]> {
    let last = x_s.len() - 1;
    let mut corners = vec![[x_s[0], floor[0]]];
    let mut before: Option<[f64; 2]> = None;
    for at in (0..=last).filter(|&at| floor[at] >= y_us[at]) {
        let own = [x_s[at], y_us[at]];
        if let Some(other) = before.filter(|_| drift_ppm > 0.0) {
            let x = other[0].midpoint(own[0]) + (own[1] - other[1]) / (2.0 * drift_ppm);
            let x = x.clamp(other[0], own[0]);
            corners.push([x, other[1] + drift_ppm * (x - other[0])]);
        }
        corners.push(own);
        before = Some(own);
    }
    corners.push([x_s[last], floor[last]]);
    corners.dedup_by(|next, before| next[0] <= before[0]);
    corners
}
