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
        let n = events.len();
        let (mut n_outside, mut n_disordered, mut last) = (0, 0, i64::MIN);
        events.retain(|i, event| {
            let is_inside = size.contains(event.x, event.y);
            n_outside += u64::from(!is_inside);
            let is_kept = is_inside && epochs.is_chosen(i, choice);
            if is_kept {
                n_disordered += u64::from(event.t < last);
                last = last.max(event.t);
            }
            is_kept
        });
        check_grid(n, n_outside)?;
        events.sort_by_time();
        let loss = |count, what: String| DataLoss { stream: stream.to_owned(), what, count };
        if n_outside > 0 {
            losses.push(loss(n_outside, format!("events off the {size} grid were left out")));
        }
        if n_disordered > 0 {
            losses.push(loss(n_disordered, SORTED_BY_TIME.into()));
        }
        Ok(ImportedEvents { events, size, losses, decisions: Vec::new() })
    }
}
