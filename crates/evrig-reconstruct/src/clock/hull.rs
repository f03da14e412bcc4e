//! Line below all points with the least sum of distances.
//!
//! Moon, Skelly and Towsley (INFOCOM 1999) state it as a linear programme; its solution is the edge
//! of the lower convex hull at the points' mean time (Zhang, Liu and Xia, INFOCOM 2002), found in
//! O(n). It fits offset and rate without steps.

use super::endpoint::lower_endpoint;
use super::error::ClockError;
use super::estimate::{ClockEstimate, Method, MinimumLatency, SegmentError, SegmentStart};
use super::input::FramePairs;
use super::trace::{OffsetLine, PairTrace, RESOLUTION_US};
use evrig_core::stats::Estimate;
use evrig_core::time::Clock;
use std::ops::Range;

/// One line over the whole recording; its interval holds at the middle.
///
/// # Errors
/// None for checked pairs; the signature is that of every method.
pub fn hull<A: Clock, B: Clock>(
    pairs: &FramePairs<A, B>,
    latency: MinimumLatency,
) -> Result<ClockEstimate<A, B>, ClockError> {
    let trace = PairTrace::new(pairs.pairs());
    let all = 0..trace.x_s.len();
    let fit = fit(&trace.x_s, &trace.y_us, &all);
    let error =
        SegmentError::one_sided(fit.below90, fit.below95, RESOLUTION_US, latency, all.len() as u64);
    let skew = Estimate::normal(fit.line.slope_ppm, fit.slope_error_ppm(), all.len() as u64);
    let segment = trace
        .segment(&all, SegmentStart::Beginning, fit.line, latency.subtracted())
        .with_error(Some(error))
        .with_skew(skew);
    let mut diagnostics = trace.diagnostics(|index| fit.line.at(trace.x_s[index]));
    diagnostics.tail_index = Some(fit.tail_index);
    Ok(ClockEstimate {
        method: Method::Hull,
        segments: vec![segment],
        minimum_latency: latency,
        doubtful: Vec::new(),
        tally: pairs.tally(),
        diagnostics,
    })
}

/// Error of a fitted line over that of a constant, by simulation: the line is farther from the
/// truth than a minimum, and uses two samples.
const LINE_ERROR_FACTOR: f64 = 1.6;

/// The hull's line over a range of frames, with its error.
#[derive(Debug, Clone, Copy)]
pub(super) struct LineFit {
    pub(super) line: OffsetLine,
    /// Mean time of the points, where the line's error is one-sided.
    pub(super) mean_s: f64,
    pub(super) half_span_s: f64,
    pub(super) below95: f64,
    pub(super) below90: f64,
    pub(super) tail_index: f64,
}

impl LineFit {
    /// Approximate standard error of the slope, from the one-sided error at either end.
    pub(super) fn slope_error_ppm(&self) -> f64 {
        if self.half_span_s > 0.0 { 0.5 * self.below95 / self.half_span_s } else { f64::NAN }
    }
}

/// Fits the line to `range`, which must not be empty.
pub(super) fn fit(x_s: &[f64], y_us: &[f64], range: &Range<usize>) -> LineFit {
    let (x, y) = (&x_s[range.clone()], &y_us[range.clone()]);
    let mean_s = x.iter().sum::<f64>() / x.len() as f64;
    let line = edge_at(x, y, mean_s);
    let residuals: Vec<f64> = x.iter().zip(y).map(|(x, y)| y - line.at(*x)).collect();
    let endpoint = lower_endpoint(&residuals);
    let below = |gap: Option<f64>| gap.map_or(f64::INFINITY, |gap| LINE_ERROR_FACTOR * gap);
    LineFit {
        line,
        mean_s,
        half_span_s: 0.5 * (x[x.len() - 1] - x[0]),
        below95: below(endpoint.map(|end| end.below95)),
        below90: below(endpoint.map(|end| end.below90)),
        tail_index: endpoint.map_or(f64::NAN, |end| end.tail_index),
    }
}

/// Edge of the lower convex hull at `at`; `x` increases strictly.
fn edge_at(x: &[f64], y: &[f64], at: f64) -> OffsetLine {
    let mut hull: Vec<usize> = Vec::new();
    for next in 0..x.len() {
        while let [.., before, last] = hull[..] {
            let rise = (y[last] - y[before]) * (x[next] - x[before]);
            let chord = (y[next] - y[before]) * (x[last] - x[before]);
            if rise < chord {
                break;
            }
            hull.pop();
        }
        hull.push(next);
    }
    let right = hull.partition_point(|&vertex| x[vertex] < at).clamp(1, hull.len().max(2) - 1);
    match (hull.get(right - 1), hull.get(right)) {
        (Some(&a), Some(&b)) => OffsetLine::through([x[a], y[a]], [x[b], y[b]]),
        (Some(&a), None) => OffsetLine { x_s: x[a], offset_us: y[a], slope_ppm: 0.0 },
        _ => OffsetLine::constant(0.0),
    }
}
