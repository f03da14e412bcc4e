//! Frame pairs as numbers relative to the first, for the fits.

use super::estimate::{ClockSegment, Diagnostics, SegmentError, SegmentStart};
use super::input::FramePair;
use evrig_core::stats::{Estimate, quantile_sorted};
use evrig_core::time::{Clock, ClockMap, Span, Stamp};
use std::ops::Range;

/// Error of a stamp, µs: microsecond resolution on both sides and interrupt latency.
pub(super) const RESOLUTION_US: f64 = 3.0;

/// Pairs relative to the first: seconds since it, and RealTime minus sensor time, µs.
#[derive(Debug)]
pub(super) struct PairTrace<'a, A: Clock, B: Clock> {
    pub(super) pairs: &'a [FramePair<A, B>],
    pub(super) x_s: Vec<f64>,
    pub(super) y_us: Vec<f64>,
}

/// A line in the coordinates of a trace: `offset_us` at `x_s`, `slope_ppm` µs a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OffsetLine {
    pub(super) x_s: f64,
    pub(super) offset_us: f64,
    pub(super) slope_ppm: f64,
}

impl OffsetLine {
    pub(super) fn constant(offset_us: f64) -> Self {
        Self { x_s: 0.0, offset_us, slope_ppm: 0.0 }
    }

    pub(super) fn at(&self, x_s: f64) -> f64 {
        self.offset_us + (x_s - self.x_s) * self.slope_ppm
    }

    pub(super) fn through(a: [f64; 2], b: [f64; 2]) -> Self {
        let run = b[0] - a[0];
        let slope_ppm = if run > 0.0 { (b[1] - a[1]) / run } else { 0.0 };
        Self { x_s: a[0], offset_us: a[1], slope_ppm }
    }
}

impl<'a, A: Clock, B: Clock> PairTrace<'a, A, B> {
    /// The trace of pairs, of which there must be one at least.
    pub(super) fn new(pairs: &'a [FramePair<A, B>]) -> Self {
        let since = |pair: &FramePair<A, B>| pair.sensor - pairs[0].sensor;
        let later = |pair: &FramePair<A, B>| (pair.real - pairs[0].real) - since(pair);
        Self {
            pairs,
            x_s: pairs.iter().map(|pair| since(pair).as_secs_f64()).collect(),
            y_us: pairs.iter().map(|pair| later(pair).as_nanos() as f64 * 1e-3).collect(),
        }
    }

    pub(super) fn duration_s(&self) -> f64 {
        self.x_s.last().copied().unwrap_or(0.0)
    }

    pub(super) fn stamp(&self, x_s: f64) -> Stamp<B> {
        self.pairs[0].sensor + Span::from_secs_f64(x_s)
    }

    /// The map of a line, anchored at `x_s`, with `latency` subtracted.
    pub(super) fn map(&self, line: OffsetLine, x_s: f64, latency: Span) -> ClockMap<A, B> {
        let b0 = self.stamp(x_s);
        let offset = Span::from_secs_f64(line.at(x_s) * 1e-6);
        let since = b0 - self.pairs[0].sensor;
        let a0 = self.pairs[0].real + since + offset - latency;
        ClockMap { a0, b0, skew: line.slope_ppm * 1e-6 }
    }

    /// A segment over a range of frames with one line.
    pub(super) fn segment(
        &self,
        range: &Range<usize>,
        start: SegmentStart,
        line: OffsetLine,
        latency: Span,
    ) -> ClockSegment<A, B> {
        let (first, last) = (range.start, range.end - 1);
        let middle = self.x_s[first].midpoint(self.x_s[last]);
        ClockSegment {
            first: self.pairs[first].sensor,
            last: self.pairs[last].sensor,
            start,
            map: self.map(line, middle, latency),
            skew_ppm: None,
            error: None,
            n_used: range.len() as u64,
        }
    }

    /// Latency quantiles and stalls, given the map at each frame (µs, as `y_us`).
    pub(super) fn diagnostics(&self, map_us: impl Fn(usize) -> f64) -> Diagnostics {
        let mut latency: Vec<f64> =
            self.y_us.iter().enumerate().map(|(index, y)| y - map_us(index)).collect();
        latency.sort_by(f64::total_cmp);
        let quantiles = [0.0, 0.05, 0.5, 0.95, 1.0].map(|q| quantile_sorted(&latency, q));
        let interval_us = self.duration_s() * 1e6 / self.x_s.len().max(2) as f64;
        let stalled = quantiles[2] + 3.0 * interval_us;
        let n_stalled = (latency.len() - latency.partition_point(|l| *l <= stalled)) as u64;
        Diagnostics { latency_us: Some(quantiles), n_stalled, ..Diagnostics::default() }
    }
}

impl<A: Clock, B: Clock> ClockSegment<A, B> {
    pub(super) fn with_error(mut self, error: Option<SegmentError>) -> Self {
        self.error = error;
        self
    }

    pub(super) fn with_skew(mut self, skew_ppm: Estimate) -> Self {
        self.skew_ppm = Some(skew_ppm);
        self
    }
}
