//! Event filters.
//!
//! A filter maps events to kept events and a [`DropTally`] with the dropped ones by reason. Real
//! and generated streams need the same filters; filtering only one would introduce a difference.
//!
//! | filter | drops |
//! | --- | --- |
//! | [`refractory`] | an event too soon after the last kept one of its pixel |
//! | [`background`] | an event without a recent event of a neighbour |
//! | [`hot_pixel`] | all events of pixels with far too high rates |
//! | [`region`] | an event outside a moving region at the event's time |
//! | [`rate`] | events above a rate limit, thinned evenly |
//!
//! All need ascending time and events on the grid, and the whole stream in one call.

pub mod background;
pub mod hot_pixel;
pub mod rate;
pub mod refractory;
pub mod region;
mod tally;

pub use tally::{DropReason, DropTally};

use evrig_core::event::{EventSlice, Events};
use evrig_core::geometry::Size;

/// Why a stream cannot be filtered.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum FilterError {
    /// Time must not fall.
    #[error(
        "event {index} at {t_us} us is earlier than the one before it ({previous_us} us); \
         sort the stream by time"
    )]
    TimeNotAscending {
        /// Number of the event, from 0.
        index: usize,
        /// Its time.
        t_us: i64,
        /// Time of the event before it.
        previous_us: i64,
    },
    /// Events lie on the grid.
    #[error("event {index} is at pixel ({x}, {y}), outside the grid of {size}")]
    OutsideGrid {
        /// Number of the event, from 0.
        index: usize,
        /// Pixel column.
        x: u16,
        /// Pixel row.
        y: u16,
        /// The grid.
        size: Size,
    },
    /// A setting is out of its range.
    #[error("{name} is {found}, expected {expected}")]
    BadSetting {
        /// The setting.
        name: &'static str,
        /// Its value.
        found: f64,
        /// What it must be.
        expected: &'static str,
    },
}

/// The kept events, and the counts by reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Filtered {
    /// Kept events in their order.
    pub events: Events,
    /// Counts.
    pub tally: DropTally,
}

/// Events that are checked and filtered together, in the cache.
const CHUNK: usize = 4_096;

/// Keeps the events for which `is_kept(time, pixel index)` holds, called in order.
///
/// Compaction within a chunk is branch-free, as noise makes a branch unpredictable.
fn keep(
    events: EventSlice<'_>,
    size: Size,
    reason: DropReason,
    mut is_kept: impl FnMut(i64, usize) -> bool,
) -> Result<Filtered, FilterError> {
    // Reserves address space only.
    let mut kept = Events::with_capacity(events.len());
    let (mut t, mut x) = (vec![0; CHUNK], vec![0; CHUNK]);
    let (mut y, mut on) = (vec![0; CHUNK], vec![false; CHUNK]);
    let mut previous_us = i64::MIN;
    for start in (0..events.len()).step_by(CHUNK) {
        let chunk = events.range(start, (start + CHUNK).min(events.len()));
        check(chunk, size, start, previous_us)?;
        previous_us = chunk.t[chunk.len() - 1];
        let mut end = 0;
        let rows = chunk.t.iter().zip(chunk.x).zip(chunk.y).zip(chunk.on);
        for (((&event_t, &event_x), &event_y), &event_on) in rows {
            t[end] = event_t;
            x[end] = event_x;
            y[end] = event_y;
            on[end] = event_on;
            end += usize::from(is_kept(event_t, size.index(event_x, event_y)));
        }
        let stayed = EventSlice { t: &t[..end], x: &x[..end], y: &y[..end], on: &on[..end] };
        kept.extend_from_slice(stayed);
    }
    let tally = DropTally::of(events.len() as u64, kept.len() as u64, reason);
    Ok(Filtered { events: kept, tally })
}

/// Checks a chunk that begins at event `start`, after one at `previous_us`. Without early return,
/// so that the loops vectorise.
fn check(
    chunk: EventSlice<'_>,
    size: Size,
    start: usize,
    previous_us: i64,
) -> Result<(), FilterError> {
    let ascends = chunk.t.windows(2).fold(true, |ok, pair| ok & (pair[0] <= pair[1]));
    let x = chunk.x.iter().fold(0, |most, &x| x.max(most));
    let y = chunk.y.iter().fold(0, |most, &y| y.max(most));
    let first_us = chunk.t.first().copied().unwrap_or(previous_us);
    if first_us < previous_us {
        return Err(FilterError::TimeNotAscending { index: start, t_us: first_us, previous_us });
    }
    if !ascends && let Some(i) = chunk.first_disorder() {
        let (t_us, previous_us) = (chunk.t[i], chunk.t[i - 1]);
        return Err(FilterError::TimeNotAscending { index: start + i, t_us, previous_us });
    }
    if !chunk.is_empty()
        && !size.contains(x, y)
        && let Some(i) = chunk.first_outside(size)
    {
        let (x, y) = (chunk.x[i], chunk.y[i]);
        return Err(FilterError::OutsideGrid { index: start + i, x, y, size });
    }
    Ok(())
}

#[cfg(test)]
mod fixture;
