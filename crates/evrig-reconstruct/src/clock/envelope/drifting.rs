//! Lower envelope of a drifting clock: lines around knots.
//!
//! The rate of a crystal changes slowly with temperature and abruptly when a host slews its clock.
//! Around each knot the window grows while its line agrees with the shortest windows (intersection
//! of confidence intervals; Goldenshluger and Nemirovski, Mathematical Methods of Statistics 6,
//! 1997); between knots the map is linear.

use super::super::estimate::{MinimumLatency, SegmentError, SegmentStart};
use super::super::hull::{LineFit, fit};
use super::super::trace::{OffsetLine, PairTrace, RESOLUTION_US};
use super::piece::EnvelopePiece;
use evrig_core::stats::Estimate;
use evrig_core::time::Clock;
use std::ops::Range;

/// Knot spacing, seconds.
const KNOT_S: f64 = 2.5;
/// Window lengths tried around each knot, seconds.
const WINDOWS_S: [f64; 6] = [2.5, 5.0, 10.0, 20.0, 40.0, 60.0];
/// Fewest frames of a window.
const MIN_WINDOW_FRAMES: usize = 60;
/// Greatest distance of a line below a local knot in 95 % margins: with many knots one outlier must
/// not shorten the windows.
const MAX_MARGINS_BELOW: f64 = 2.0;
/// Change of rate allowed in every window, ppm per second (a crystal in a warming case).
const RATE_DRIFT_PPM_PER_S: f64 = 0.02;

#[derive(Debug, Clone, Copy)]
pub(super) struct EnvelopeKnot {
    x_s: f64,
    offset_us: f64,
    /// 95 % margins below and above.
    margin95: [f64; 2],
    /// The same for 90 %.
    margin90: [f64; 2],
    slope_error_ppm: f64,
    tail_index: f64,
}

/// Linear pieces over a range of frames without a step.
pub(super) fn pieces<A: Clock, B: Clock>(
    trace: &PairTrace<'_, A, B>,
    range: &Range<usize>,
    latency: MinimumLatency,
) -> Vec<EnvelopePiece<A, B>> {
    let (from, to) = (trace.x_s[range.start], trace.x_s[range.end - 1]);
    let n_pieces = ((to - from) / KNOT_S).round().max(1.0);
    let place = |number: usize| from + (to - from) * number as f64 / n_pieces;
    let places: Vec<f64> = (0..=n_pieces as usize).map(place).collect();
    let local: Vec<EnvelopeKnot> = places.iter().map(|&x_s| shortest(trace, range, x_s)).collect();
    let knots: Vec<EnvelopeKnot> =
        places.iter().map(|&x_s| longest(trace, range, x_s, &local)).collect();
    let mut begin = range.start;
    let mut pieces = Vec::with_capacity(knots.len());
    for (number, pair) in knots.windows(2).enumerate() {
        let is_last = number + 2 == knots.len();
        let within = trace.x_s[begin..range.end].partition_point(|x| *x < pair[1].x_s);
        let end = if is_last { range.end } else { begin + within };
        if begin < end {
            pieces.push(piece(trace, begin..end, [pair[0], pair[1]], latency));
        }
        begin = end;
    }
    if let Some(first) = pieces.first_mut() {
        first.segment.start = SegmentStart::Beginning;
    }
    pieces
}

fn piece<A: Clock, B: Clock>(
    trace: &PairTrace<'_, A, B>,
    frames: Range<usize>,
    [left, right]: [EnvelopeKnot; 2],
    latency: MinimumLatency,
) -> EnvelopePiece<A, B> {
    let line = OffsetLine::through([left.x_s, left.offset_us], [right.x_s, right.offset_us]);
    let larger = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
    let margin95 = larger(left.margin95, right.margin95);
    let margin90 = larger(left.margin90, right.margin90);
    let n = frames.len() as u64;
    let error = SegmentError::two_sided(margin90, margin95, latency, n);
    let slope_error = left.slope_error_ppm.max(right.slope_error_ppm);
    let segment = trace
        .segment(&frames, SegmentStart::Bend, line, latency.subtracted())
        .with_error(Some(error))
        .with_skew(Estimate::normal(line.slope_ppm, slope_error, n));
    let tail_index = left.tail_index.is_finite().then_some(left.tail_index);
    EnvelopePiece { segment, frames, line, tail_index }
}

/// The envelope at `x_s` over the shortest window with enough frames.
fn shortest<A: Clock, B: Clock>(
    trace: &PairTrace<'_, A, B>,
    range: &Range<usize>,
    x_s: f64,
) -> EnvelopeKnot {
    let frames = WINDOWS_S
        .into_iter()
        .map(|length| window(&trace.x_s, range, x_s, length))
        .find(|frames| frames.len() >= MIN_WINDOW_FRAMES)
        .unwrap_or_else(|| range.clone());
    within(&fit(&trace.x_s, &trace.y_us, &frames), x_s)
}

/// The envelope at `x_s` over the longest window whose line agrees with all local knots.
fn longest<A: Clock, B: Clock>(
    trace: &PairTrace<'_, A, B>,
    range: &Range<usize>,
    x_s: f64,
    local: &[EnvelopeKnot],
) -> EnvelopeKnot {
    let mut best = shortest(trace, range, x_s);
    let mut before = 0..0;
    for length in WINDOWS_S {
        let frames = window(&trace.x_s, range, x_s, length);
        if frames == before || frames.len() < MIN_WINDOW_FRAMES {
            continue;
        }
        let fit = fit(&trace.x_s, &trace.y_us, &frames);
        let covered = trace.x_s[frames.start]..=trace.x_s[frames.end - 1];
        // The line is below all points; too far below some of them means that the envelope is
        // curved there.
        let agrees = |knot: &EnvelopeKnot| {
            fit.line.at(knot.x_s) >= knot.offset_us - MAX_MARGINS_BELOW * knot.margin95[0]
        };
        if !local.iter().filter(|knot| covered.contains(&knot.x_s)).all(agrees) {
            break;
        }
        best = within(&fit, x_s);
        before = frames;
    }
    best
}

/// Frames within a window of `length_s` around `x_s`, moved into the range.
fn window(x: &[f64], range: &Range<usize>, x_s: f64, length_s: f64) -> Range<usize> {
    let own = &x[range.clone()];
    let (first, last) = (own[0], own[own.len() - 1]);
    let from = (x_s - 0.5 * length_s).min(last - length_s).max(first);
    let start = own.partition_point(|x| *x < from);
    let end = own.partition_point(|x| *x <= from + length_s);
    range.start + start..range.start + end.max(start + 1)
}

/// Value and error of a fitted line at `x_s`.
fn within(fit: &LineFit, x_s: f64) -> EnvelopeKnot {
    let reach =
        if fit.half_span_s > 0.0 { (x_s - fit.mean_s).abs() / fit.half_span_s } else { 0.0 };
    let bend = 0.5 * RATE_DRIFT_PPM_PER_S * (fit.half_span_s * (1.0 + reach)).powi(2) * 0.5;
    let margin = |below: f64| {
        // Away from the middle the error of the slope adds on both sides.
        let tilt = reach * below;
        [below + tilt + bend + RESOLUTION_US, tilt + bend + RESOLUTION_US]
    };
    EnvelopeKnot {
        x_s,
        offset_us: fit.line.at(x_s),
        margin95: margin(fit.below95),
        margin90: margin(fit.below90),
        slope_error_ppm: fit.slope_error_ppm(),
        tail_index: fit.tail_index,
    }
}
