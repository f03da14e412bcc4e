//! Counts of kept and dropped events.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Why an event was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DropReason {
    /// Too soon after the pixel's last kept event.
    Refractory,
    /// No recent event of a neighbour.
    Background,
    /// Its pixel is hot.
    HotPixel,
    /// Not in the region at its time.
    OutsideRegion,
    /// At a time at which the region's position is unknown.
    NoPath,
    /// More events than the limit.
    Rate,
}

/// Counts of a filter: seen = kept + all dropped.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct DropTally {
    /// Input events.
    pub seen: u64,
    /// Kept events.
    pub kept: u64,
    /// Dropped events by reason, without zeros.
    pub dropped: BTreeMap<DropReason, u64>,
}

impl DropTally {
    /// The tally of a filter with one reason.
    pub(super) fn of(seen: u64, kept: u64, reason: DropReason) -> Self {
        let n_dropped = seen - kept;
        let dropped = (n_dropped > 0).then_some((reason, n_dropped)).into_iter().collect();
        Self { seen, kept, dropped }
    }

    /// Events dropped for any reason.
    #[must_use]
    pub fn n_dropped(&self) -> u64 {
        self.dropped.values().sum()
    }

    /// The tally of this filter followed by another one.
    #[must_use]
    pub fn then(mut self, next: &Self) -> Self {
        for (&reason, &n) in &next.dropped {
            *self.dropped.entry(reason).or_default() += n;
        }
        self.kept = next.kept;
        self
    }

    /// Whether every event is accounted for.
    #[must_use]
    pub fn balances(&self) -> bool {
        self.seen == self.kept + self.n_dropped()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_in_a_row_account_for_every_event() {
        let first = DropTally::of(100, 70, DropReason::HotPixel);
        let second = DropTally::of(70, 70, DropReason::Rate);
        let third = DropTally::of(70, 20, DropReason::Background);
        let all = first.then(&second).then(&third);
        assert_eq!((all.seen, all.kept, all.n_dropped()), (100, 20, 80));
        assert!(all.balances());
        let json = serde_json::to_string(&all).unwrap();
        assert_eq!(json, r#"{"seen":100,"kept":20,"dropped":{"background":50,"hot_pixel":30}}"#);
    }
}
