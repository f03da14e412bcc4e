//! The paper's criterion over windows: where the clocks' mean intervals agree best.
//!
//! Over a window of a second the two mean intervals differ only by the latencies of its first and
//! last frame. The median difference within the best window has less variance than one frame's, and
//! its bias is that of the median latency. The window's mean would be worse than the original
//! wherever a frame is delayed.

use super::error::ClockError;
use super::estimate::{ClockEstimate, Method, PaperChoice};
use super::input::FramePairs;
use super::paper_interval::whole_recording;
use super::trace::{OffsetLine, PairTrace};
use evrig_core::time::{Clock, Span};

/// Length of a window, seconds.
const WINDOW_S: f64 = 1.0;

/// The median difference of the best window, without an error.
///
/// # Errors
/// A recording shorter than a window.
pub fn paper_window<A: Clock, B: Clock>(
    pairs: &FramePairs<A, B>,
) -> Result<ClockEstimate<A, B>, ClockError> {
    let trace = PairTrace::new(pairs.pairs());
    let (x, y) = (&trace.x_s, &trace.y_us);
    // Relative difference of the mean intervals between frames `from` and `to`.
    let mismatch = |from: usize, to: usize| (y[to] - y[from]).abs() / (x[to] - x[from]);
    let mut best: Option<(f64, usize, usize)> = None;
    let mut to = 0;
    for from in 0..x.len() {
        while to < x.len() && x[to] - x[from] < WINDOW_S {
            to += 1;
        }
        if to == x.len() {
            break;
        }
        let candidate = mismatch(from, to);
        if best.is_none_or(|(least, ..)| candidate < least) {
            best = Some((candidate, from, to));
        }
    }
    let Some((mismatch_ppm, from, to)) = best else {
        let per_s = x.len() as f64 / trace.duration_s().max(1e-3);
        let needed = (per_s * WINDOW_S).ceil() as usize + 1;
        return Err(ClockError::TooFewFrames { found: x.len(), needed });
    };
    let mut window = y[from..=to].to_vec();
    let middle = window.len() / 2;
    let offset_us = *window.select_nth_unstable_by(middle, f64::total_cmp).1;
    let map = trace.map(OffsetLine::constant(offset_us), x[from], Span::ZERO);
    let choice = PaperChoice {
        frame: from as u64,
        ratio: Some(1.0 / (1.0 + mismatch_ppm * 1e-6)),
        n_ties: 0,
        n_undefined: 0,
    };
    let mut estimate = whole_recording(Method::PaperWindow, pairs.pairs(), map, choice);
    estimate.tally = pairs.tally();
    Ok(estimate)
}
