//! Lower envelope of the latencies between steps: the default for frame pairs.
//!
//! SensorTimestamp and RealTime of one Linux host are steered at the same rate. Their difference is
//! constant between steps, and its lower bound is the minimum. A device with its own crystal
//! drifts; there the lower bound is a line fitted around each of many knots, over the longest
//! window in which it is straight.

use super::endpoint::lower_endpoint;
use super::error::ClockError;
use super::estimate::{
    ClockEstimate, ClockSegment, Method, MinimumLatency, SegmentError, SegmentStart,
};
use super::input::FramePairs;
use super::trace::{OffsetLine, PairTrace, RESOLUTION_US};
use evrig_core::time::{Clock, Span, Stamp};
use piece::EnvelopePiece;
use std::ops::Range;

mod drifting;
mod piece;

/// Relative rate of the two clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RateModel {
    /// Both clocks belong to one host: equal rates by construction.
    #[default]
    SameHost,
    /// The source has its own crystal.
    Device,
}

/// Options of the envelope method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EnvelopeOptions {
    /// Relative rate of the clocks.
    pub rate: RateModel,
    /// Knowledge of the minimum latency.
    pub latency: MinimumLatency,
    /// Smaller changes are latency; larger ones are a set clock.
    pub step_threshold: Span,
}

impl Default for EnvelopeOptions {
    fn default() -> Self {
        Self {
            rate: RateModel::SameHost,
            latency: MinimumLatency::Unknown,
            step_threshold: Span::from_micros(3_000),
        }
    }
}

/// Offset between steps from the minimum latency, with a calibrated interval.
///
/// # Errors
/// None for checked pairs; the signature is that of every method.
pub fn envelope<A: Clock, B: Clock>(
    pairs: &FramePairs<A, B>,
    options: &EnvelopeOptions,
) -> Result<ClockEstimate<A, B>, ClockError> {
    let trace = PairTrace::new(pairs.pairs());
    let threshold_us = options.step_threshold.as_nanos() as f64 * 1e-3;
    let ranges = super::steps::between_steps(&trace.x_s, &trace.y_us, threshold_us);
    let mut segments: Vec<ClockSegment<A, B>> = Vec::new();
    let mut offsets_us = Vec::with_capacity(trace.x_s.len());
    let mut tail_index = None;
    for (number, range) in ranges.iter().enumerate() {
        let pieces = match options.rate {
            RateModel::SameHost => vec![constant(&trace, range, options.latency)],
            RateModel::Device => drifting::pieces(&trace, range, options.latency),
        };
        for piece in &pieces {
            let line = piece.line;
            offsets_us.extend(piece.frames.clone().map(|frame| line.at(trace.x_s[frame])));
        }
        tail_index = tail_index.or(pieces.first().and_then(|piece| piece.tail_index));
        let n_before = segments.len();
        join(&mut segments, pieces.into_iter().map(|piece| piece.segment));
        if number > 0 {
            let at = instant_of_step(&trace, &offsets_us, range.start, options.latency);
            segments[n_before - 1].last = at;
            segments[n_before].first = at;
        }
    }
    let mut diagnostics = trace.diagnostics(|index| offsets_us[index]);
    diagnostics.tail_index = tail_index;
    Ok(ClockEstimate {
        method: Method::Envelope,
        segments,
        minimum_latency: options.latency,
        doubtful: ranges
            .windows(2)
            .map(|pair| about(&trace, [&pair[0], &pair[1]], threshold_us))
            .collect(),
        tally: pairs.tally(),
        diagnostics,
    })
}

fn constant<A: Clock, B: Clock>(
    trace: &PairTrace<'_, A, B>,
    range: &Range<usize>,
    latency: MinimumLatency,
) -> EnvelopePiece<A, B> {
    let y = &trace.y_us[range.clone()];
    let line = OffsetLine::constant(y.iter().copied().fold(f64::INFINITY, f64::min));
    let endpoint = lower_endpoint(y);
    let error = endpoint.map(|end| {
        SegmentError::one_sided(
            end.below90 + RESOLUTION_US,
            end.below95 + RESOLUTION_US,
            RESOLUTION_US,
            latency,
            range.len() as u64,
        )
    });
    let segment =
        trace.segment(range, SegmentStart::Beginning, line, latency.subtracted()).with_error(error);
    let tail_index = endpoint.map(|end| end.tail_index);
    EnvelopePiece { segment, frames: range.clone(), line, tail_index }
}

/// Appends the segments of one range; the first of them starts with a step from the previous one.
fn join<A: Clock, B: Clock>(
    segments: &mut Vec<ClockSegment<A, B>>,
    pieces: impl Iterator<Item = ClockSegment<A, B>>,
) {
    for mut piece in pieces {
        if let (Some(before), SegmentStart::Beginning) = (segments.last(), piece.start) {
            let by = piece.map.map(piece.first) - before.map.map(piece.first);
            piece.start = SegmentStart::Step { by };
        }
        segments.push(piece);
    }
}

/// Instant of a step: between the last reading of the old time and the first of the new.
///
/// RealTime is read with a latency, so that frames up to one latency before the step already show
/// the new time.
fn instant_of_step<A: Clock, B: Clock>(
    trace: &PairTrace<'_, A, B>,
    offsets_us: &[f64],
    first_new: usize,
    latency: MinimumLatency,
) -> Stamp<B> {
    let read = |frame: usize| {
        let above = Span::from_secs_f64((trace.y_us[frame] - offsets_us[frame]) * 1e-6);
        trace.pairs[frame].sensor + latency.subtracted() + above
    };
    let (old, new) = (read(first_new - 1), read(first_new));
    Stamp::from_nanos(old.as_nanos().midpoint(new.as_nanos()))
}

/// Frames around a step that may belong to its other side: two on each, and adjacent delayed
/// frames, which may have been read after a step they precede.
fn about<A: Clock, B: Clock>(
    trace: &PairTrace<'_, A, B>,
    [before, after]: [&Range<usize>; 2],
    threshold_us: f64,
) -> [Stamp<B>; 2] {
    let late = |range: &Range<usize>| {
        let y = &trace.y_us;
        let smallest = y[range.clone()].iter().copied().fold(f64::INFINITY, f64::min);
        move |frame: &usize| y[*frame] > smallest + threshold_us
    };
    let n_before = before.clone().rev().take_while(late(before)).count().max(2);
    let n_after = after.clone().take_while(late(after)).count().max(3);
    let first = before.end.saturating_sub(n_before).max(before.start);
    let last = (after.start + n_after).min(after.end) - 1;
    [trace.pairs[first].sensor, trace.pairs[last].sensor]
}
