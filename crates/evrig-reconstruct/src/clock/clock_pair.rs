//! Two-sided clock readings: the offset is bounded by the times of reading, not by latency.
//!
//! RealTime read between two readings of the sensor's clock bounds the offset by RealTime minus the
//! later and minus the earlier of them. The narrowest reading of each group is used. The bounds of
//! a segment are intersected, and a reading that contradicts them is a step. Nothing is fitted.

use super::error::ClockError;
use super::estimate::{
    ClockEstimate, ClockSegment, Diagnostics, Method, MinimumLatency, SegmentError, SegmentStart,
};
use super::input::{PairTally, TwoSidedReading};
use evrig_core::stats::quantile_sorted;
use evrig_core::time::{Clock, ClockMap, Span, Stamp};
use std::collections::BTreeMap;

/// Options of the two-sided method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PairOptions {
    /// Greatest contradiction due to clock noise; above it a clock was set.
    pub tolerance: Span,
    /// Resolution of the coarser clock's stamps.
    pub resolution: Span,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self { tolerance: Span::from_micros(1), resolution: Span::from_nanos(1) }
    }
}

/// The offset between steps from two-sided readings; its interval is a hard bound.
///
/// The readings may come in any order.
///
/// # Errors
/// No usable reading.
pub fn clock_pair<A: Clock, B: Clock>(
    readings: &[TwoSidedReading<A, B>],
    options: &PairOptions,
) -> Result<ClockEstimate<A, B>, ClockError> {
    let narrowest = narrowest_of_groups(readings);
    let Some(first) = narrowest.first().copied() else {
        let n_reversed = readings.iter().filter(|reading| reading.after < reading.before).count();
        return Err(ClockError::NoReadings { n_seen: readings.len(), n_reversed });
    };
    let bounds: Vec<OffsetBounds<B>> = narrowest
        .iter()
        .map(|reading| OffsetBounds::of(reading, first, options.resolution))
        .collect();
    let (runs, n_rejected) = runs(&bounds, options.tolerance.as_nanos());
    let segments = segments(&runs, first);
    let doubtful = runs.windows(2).map(|pair| [pair[0].last, pair[1].first]).collect();
    let mut widths: Vec<f64> = bounds.iter().map(|b| (b.high - b.low) as f64).collect();
    widths.sort_by(f64::total_cmp);
    let n_reversed = readings.iter().filter(|reading| reading.after < reading.before).count();
    Ok(ClockEstimate {
        method: Method::ClockPair,
        segments,
        minimum_latency: MinimumLatency::ClockPairs,
        doubtful,
        tally: PairTally {
            n_seen: readings.len() as u64,
            n_kept: (readings.len() - n_reversed) as u64,
            n_out_of_order: n_reversed as u64,
            ..PairTally::default()
        },
        diagnostics: Diagnostics {
            reading_width_ns: Some(
                [0.0, 0.05, 0.5, 0.95, 1.0].map(|q| quantile_sorted(&widths, q)),
            ),
            n_readings_rejected: n_rejected,
            ..Diagnostics::default()
        },
    })
}

/// Offset bounds of one reading, ns relative to the first reading.
#[derive(Debug, Clone, Copy)]
struct OffsetBounds<B: Clock> {
    from: Stamp<B>,
    to: Stamp<B>,
    low: i64,
    high: i64,
}

/// Consistent readings between two steps.
#[derive(Debug, Clone, Copy)]
struct ReadingRun<B: Clock> {
    first: Stamp<B>,
    last: Stamp<B>,
    low: i64,
    high: i64,
    n: u64,
}

impl<B: Clock> OffsetBounds<B> {
    fn of<A: Clock>(
        reading: &TwoSidedReading<A, B>,
        origin: TwoSidedReading<A, B>,
        resolution: Span,
    ) -> Self {
        let real = reading.real - origin.real;
        Self {
            from: reading.before,
            to: reading.after,
            low: (real - (reading.after - origin.before) - resolution).as_nanos(),
            high: (real - (reading.before - origin.before) + resolution).as_nanos(),
        }
    }

    fn contradicts(&self, run: &ReadingRun<B>, tolerance: i64) -> bool {
        self.low > run.high.saturating_add(tolerance)
            || self.high < run.low.saturating_sub(tolerance)
    }
}

impl<B: Clock> ReadingRun<B> {
    fn begin(bounds: &OffsetBounds<B>) -> Self {
        Self { first: bounds.from, last: bounds.to, low: bounds.low, high: bounds.high, n: 1 }
    }

    fn take(&mut self, bounds: &OffsetBounds<B>) {
        self.last = self.last.max(bounds.to);
        self.low = self.low.max(bounds.low);
        self.high = self.high.min(bounds.high);
        self.n += 1;
    }
}

fn narrowest_of_groups<A: Clock, B: Clock>(
    readings: &[TwoSidedReading<A, B>],
) -> Vec<TwoSidedReading<A, B>> {
    let mut groups: BTreeMap<u64, TwoSidedReading<A, B>> = BTreeMap::new();
    for reading in readings.iter().filter(|reading| reading.after >= reading.before) {
        let best = groups.entry(reading.group).or_insert(*reading);
        if reading.after - reading.before < best.after - best.before {
            *best = *reading;
        }
    }
    let mut narrowest: Vec<_> = groups.into_values().collect();
    narrowest.sort_by_key(|reading| reading.before);
    narrowest
}

/// Runs between steps, and the number of readings that contradict both neighbours.
fn runs<B: Clock>(bounds: &[OffsetBounds<B>], tolerance: i64) -> (Vec<ReadingRun<B>>, u64) {
    let mut runs: Vec<ReadingRun<B>> = Vec::new();
    let mut n_rejected = 0;
    for (index, own) in bounds.iter().enumerate() {
        let Some(run) = runs.last_mut() else {
            runs.push(ReadingRun::begin(own));
            continue;
        };
        if !own.contradicts(run, tolerance) {
            run.take(own);
        } else if bounds.get(index + 1).is_some_and(|next| !next.contradicts(run, tolerance)) {
            n_rejected += 1;
        } else {
            runs.push(ReadingRun::begin(own));
        }
    }
    (runs, n_rejected)
}

fn segments<A: Clock, B: Clock>(
    runs: &[ReadingRun<B>],
    origin: TwoSidedReading<A, B>,
) -> Vec<ClockSegment<A, B>> {
    let mut segments = Vec::with_capacity(runs.len());
    let mut before: Option<i64> = None;
    for run in runs {
        let offset = run.low.midpoint(run.high);
        // Bounds that cross by less than the tolerance still give a width.
        let half_us = (run.high - run.low).unsigned_abs() as f64 * 0.5e-3;
        let error =
            SegmentError::two_sided([half_us; 2], [half_us; 2], MinimumLatency::ClockPairs, run.n);
        let a0 = origin.real + (run.first - origin.before) + Span::from_nanos(offset);
        let start = before.map_or(SegmentStart::Beginning, |before| SegmentStart::Step {
            by: Span::from_nanos(offset - before),
        });
        segments.push(ClockSegment {
            first: run.first,
            last: run.last,
            start,
            map: ClockMap::from_anchor(a0, run.first),
            skew_ppm: None,
            error: Some(error),
            n_used: run.n,
        });
        before = Some(offset);
    }
    segments
}
