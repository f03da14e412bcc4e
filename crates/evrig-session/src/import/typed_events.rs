//! Events of which is known what they are, and what is kept of them.

use crate::DataLoss;
use crate::epochs::{EpochChoice, Epochs};
use evrig_core::event::Events;
use evrig_core::geometry::Size;

/// Events read from a file, what of them could not be taken, and what was decided about them.
#[derive(Debug)]
pub(super) struct ImportedEvents {
    pub(super) events: Events,
    pub(super) size: Size,
    pub(super) losses: Vec<DataLoss>,
    pub(super) decisions: Vec<String>,
}

/// The loss of order, the only one that changes no event.
pub(super) const SORTED_BY_TIME: &str = "events out of order were sorted by time";

/// Events of which is known what they are.
pub(super) struct TypedEvents {
    pub(super) events: Events,
    pub(super) size: Size,
}

impl TypedEvents {
    /// Keeps what is on the grid and of the chosen epoch, in order of time. `check_grid` refuses a
    /// number of events of which too many are off the grid.
    ///
    /// # Errors
    /// When there is no such epoch, or `check_grid` refuses.
    pub(super) fn keep(
        self,
        stream: &str,
        epochs: &Epochs,
        choice: EpochChoice,
        check_grid: impl FnOnce(usize, u64) -> Result<(), String>,
    ) -> Result<ImportedEvents, String> {
        let Self { mut events, size } = self;
        let mut losses = epochs.losses(stream, "events", choice)?;
        let n_outside = events.as_slice().count_outside(size) as u64;
        check_grid(events.len(), n_outside)?;
        if n_outside > 0 || epochs.all.len() > 1 {
            events
                .retain(|i, event| size.contains(event.x, event.y) && epochs.is_chosen(i, choice));
        }
        let n_late = events.as_slice().count_late() as u64;
        if n_late > 0 {
            events.sort_by_time();
        }
        let loss = |count, what: String| DataLoss { stream: stream.to_owned(), what, count };
        if n_outside > 0 {
            losses.push(loss(n_outside, format!("events off the {size} grid were left out")));
        }
        if n_late > 0 {
            losses.push(loss(n_late, SORTED_BY_TIME.into()));
        }
        Ok(ImportedEvents { events, size, losses, decisions: Vec::new() })
    }
}
