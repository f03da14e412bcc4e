//! Filters that tell noise from signal. Every event has a fate.
//!
//! A filter is a function from events to events and a [`Tally`]: what it has seen is what it has
//! kept plus what it has dropped, by reason. The same code and settings go over real
//! and generated streams; filtering one only would plant a difference.
//!
//! | filter | drops |
//! | --- | --- |
//! | [`refractory`] | an event too soon after the last kept one of its pixel |
//! | [`background`] | an event without a recent neighbour |
//! | [`hot_pixel`] | all events of pixels that fire far too often |
//! | [`rate`] | events beyond what a link or a display can take, thinned evenly |
//!
//! All need ascending time and events on the grid. Those that look back keep state only
//! within one call, so a stream is filtered in one piece.

pub mod background;
pub mod hot_pixel;
pub mod rate;
pub mod refractory;
mod tally;

pub use tally::{Reason, Tally};

use crate::event::{EventSlice, Events};
use crate::geometry::Size;

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
    /// A setting makes no sense.
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

/// Events that were kept, and the fate of all.
#[derive(Debug, Clone, PartialEq)]
pub struct Filtered {
    /// Kept events in the order in which they came.
    pub events: Events,
    /// Seen, kept, dropped.
    pub tally: Tally,
}

fn check(events: EventSlice<'_>, size: Size) -> Result<(), FilterError> {
    if let Some(index) = events.first_disorder() {
        let (t_us, previous_us) = (events.t[index], events.t[index - 1]);
        return Err(FilterError::TimeNotAscending { index, t_us, previous_us });
    }
    match events.first_outside(size) {
        None => Ok(()),
        Some(index) => {
            let (x, y) = (events.x[index], events.y[index]);
            Err(FilterError::OutsideGrid { index, x, y, size })
        }
    }
}

/// Keeps the events for which `is_kept` holds, asked in order with event number and pixel index.
///
/// The columns are written without a branch: each event is stored at the place of the next kept one
/// and the place moves on only if it stays. Noise makes a branch unpredictable.
fn keep(
    events: EventSlice<'_>,
    size: Size,
    reason: Reason,
    mut is_kept: impl FnMut(i64, usize) -> bool,
) -> Filtered {
    let n = events.len();
    let (mut t, mut x) = (vec![0; n], vec![0; n]);
    let (mut y, mut on) = (vec![0; n], vec![false; n]);
    let mut end = 0;
    let rows = events.t.iter().zip(events.x).zip(events.y).zip(events.on);
    for (((&event_t, &event_x), &event_y), &event_on) in rows {
        t[end] = event_t;
        x[end] = event_x;
        y[end] = event_y;
        on[end] = event_on;
        end += usize::from(is_kept(event_t, size.index(event_x, event_y)));
    }
    t.truncate(end);
    x.truncate(end);
    y.truncate(end);
    on.truncate(end);
    let tally = Tally::of(n as u64, end as u64, reason);
    // The four columns were cut alike, so they cannot be unequal.
    let events = Events::from_columns(t, x, y, on).unwrap_or_default();
    Filtered { events, tally }
}

#[cfg(test)]
mod fixture;
