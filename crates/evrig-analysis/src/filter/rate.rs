//! Thins a stream to a maximum number of events per time step, counted from the first event. In a
//! step with more, every n/limit-th event is kept.

use super::{DropReason, FilterError, Filtered, keep};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Keeps at most `max_events` in every step of `step_us` microseconds; both above 0.
///
/// # Errors
/// Events out of order or off the grid; a setting out of its range.
pub fn filter(
    events: EventSlice<'_>,
    size: Size,
    max_events: u64,
    step_us: i64,
) -> Result<Filtered, FilterError> {
    let bad = |name, found: f64| {
        Err(FilterError::BadSetting { name, found, expected: "a number above 0" })
    };
    if max_events == 0 {
        return bad("max_events", 0.0);
    }
    if step_us <= 0 {
        return bad("step_us", step_us as f64);
    }
    let mut step = RateStep { end: 0, n: 0, seen: 0 };
    keep(events, size, DropReason::Rate, |_, _| {
        if step.end == 0 || step.seen == step.n {
            step = step.next(events.t, step_us);
        }
        let number = u128::from(step.seen);
        step.seen += 1;
        // Event i of n is kept if the integer i * max / n increases with it.
        let (n, max) = (u128::from(step.n), u128::from(max_events));
        n <= max || (number + 1) * max / n > number * max / n
    })
}

/// A time step with events.
#[derive(Clone, Copy)]
struct RateStep {
    /// Index of the first event after it.
    end: usize,
    /// Events in it.
    n: u64,
    /// Events passed so far.
    seen: u64,
}

impl RateStep {
    fn next(self, times: &[i64], step_us: i64) -> Self {
        let (Some(&first), Some(&origin)) = (times.get(self.end), times.first()) else {
            return Self { end: self.end, n: 0, seen: 0 };
        };
        let since_origin = i128::from(first) - i128::from(origin);
        let step = i128::from(step_us);
        let to = i128::from(origin) + (since_origin / step + 1) * step;
        let n = times[self.end..].partition_point(|&t| i128::from(t) < to);
        Self { end: self.end + n, n: n as u64, seen: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::fixture::{SIZE, at, scattered, times};

    #[test]
    fn a_busy_step_is_thinned_evenly_and_a_quiet_one_is_left_alone() {
        let busy = (0..10).map(|i| (100 + i, 1, 1));
        let quiet = (0..3).map(|i| (200 + i, 1, 1));
        let events = at(&busy.chain(quiet).collect::<Vec<_>>());
        let filtered = filter(events.as_slice(), SIZE, 5, 50).unwrap();
        assert_eq!(times(&filtered.events), [101, 103, 105, 107, 109, 200, 201, 202]);
        assert_eq!(filtered.tally.dropped[&DropReason::Rate], 5);
        assert!(filtered.tally.balances());
    }

    #[test]
    fn no_step_holds_more_than_the_limit_and_a_full_step_holds_exactly_that() {
        let events = scattered(20_000);
        let filtered = filter(events.as_slice(), SIZE, 7, 1_000).unwrap();
        let origin = events.as_slice().t[0];
        let per_step = |t: &[i64]| {
            let mut counts = std::collections::BTreeMap::new();
            t.iter().for_each(|t| *counts.entry((t - origin) / 1_000).or_insert(0) += 1);
            counts
        };
        let kept = per_step(filtered.events.as_slice().t);
        for (step, n) in per_step(events.as_slice().t) {
            assert_eq!(kept[&step], n.min(7), "step {step}");
        }
    }

    #[test]
    fn stamps_at_the_ends_of_time_and_settings_of_zero_do_no_harm() {
        let events = at(&[(i64::MIN, 1, 1), (0, 1, 1), (i64::MAX, 1, 1)]);
        assert_eq!(filter(events.as_slice(), SIZE, 1, 1).unwrap().tally.kept, 3);
        assert!(filter(events.as_slice(), SIZE, 0, 1).is_err());
        assert!(filter(events.as_slice(), SIZE, 1, 0).is_err());
        assert!(filter(at(&[]).as_slice(), SIZE, 1, 1).unwrap().events.is_empty());
    }
}
