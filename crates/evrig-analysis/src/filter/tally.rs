//! The fate of every event.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Why an event was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Too soon after the pixel's last kept event.
    Refractory,
    /// No recent event near it.
    Background,
    /// Its pixel is hot.
    HotPixel,
    /// Not in the region at its time.
    OutsideRegion,
    /// At a time at which nobody knows where the region is.
    NoPath,
    /// More events than the limit.
    Rate,
}

/// How many events a filter has seen and what became of them: seen = kept + all dropped.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Tally {
    /// Events that came in.
    pub seen: u64,
    /// Events that went on.
    pub kept: u64,
    /// Events that did not, by reason; a reason that dropped none is absent.
    pub dropped: BTreeMap<Reason, u64>,
}

impl Tally {
    /// The tally of a filter with one reason.
    pub(super) fn of(seen: u64, kept: u64, reason: Reason) -> Self {
        let n_dropped = seen - kept;
        let dropped = (n_dropped > 0).then_some((reason, n_dropped)).into_iter().collect();
        Self { seen, kept, dropped }
    }

    /// Events dropped for any reason.
    #[must_use]
    pub fn n_dropped(&self) -> u64 {
        self.dropped.values().sum()
    }

    /// The tally of this filter and one after it that saw what this one kept.
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
        let first = Tally::of(100, 70, Reason::HotPixel);
        let second = Tally::of(70, 70, Reason::Rate);
        let third = Tally::of(70, 20, Reason::Background);
        let all = first.then(&second).then(&third);
        assert_eq!((all.seen, all.kept, all.n_dropped()), (100, 20, 80));
        assert!(all.balances());
        let json = serde_json::to_string(&all).unwrap();
        assert_eq!(json, r#"{"seen":100,"kept":20,"dropped":{"background":50,"hot_pixel":30}}"#);
    }
}
