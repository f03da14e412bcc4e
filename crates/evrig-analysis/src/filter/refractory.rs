//! Drops an event less than a given time after the last **kept** event of its pixel, of either
//! polarity, like the refractory period of a pixel.

use super::{DropReason, FilterError, Filtered, keep};
use evrig_core::event::{EventSlice, RefractoryFilter};
use evrig_core::geometry::Size;

/// Filters with a refractory period of `period_us` microseconds; 0 keeps everything.
///
/// # Errors
/// Events out of order or off the grid; a negative period.
pub fn filter(events: EventSlice<'_>, size: Size, period_us: i64) -> Result<Filtered, FilterError> {
    if period_us < 0 {
        let found = period_us as f64;
        return Err(FilterError::BadSetting { name: "period_us", found, expected: "0 or more" });
    }
    let mut dead = RefractoryFilter::new(size, period_us);
    keep(events, size, DropReason::Refractory, |t, pixel| dead.passes(t, pixel))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::fixture::{SIZE, at, scattered, times};

    #[test]
    fn a_pixel_is_dead_for_the_period_and_its_neighbour_is_not() {
        let events = at(&[(0, 1, 1), (9, 1, 1), (9, 2, 1), (10, 1, 1), (19, 1, 1), (20, 1, 1)]);
        let filtered = filter(events.as_slice(), SIZE, 10).unwrap();
        assert_eq!(times(&filtered.events), [0, 9, 10, 20]);
        assert_eq!(filtered.tally.dropped[&DropReason::Refractory], 2);
        assert!(filtered.tally.balances());
    }

    #[test]
    fn a_dropped_event_does_not_prolong_the_dead_time() {
        let events = at(&[(0, 1, 1), (6, 1, 1), (12, 1, 1)]);
        assert_eq!(times(&filter(events.as_slice(), SIZE, 10).unwrap().events), [0, 12]);
    }

    #[test]
    fn no_period_keeps_everything_and_twice_is_as_once() {
        let events = scattered(5_000);
        assert_eq!(filter(events.as_slice(), SIZE, 0).unwrap().events, events);
        let once = filter(events.as_slice(), SIZE, 700).unwrap();
        assert!(once.tally.n_dropped() > 100);
        let twice = filter(once.events.as_slice(), SIZE, 700).unwrap();
        assert_eq!(twice.events, once.events);
    }

    #[test]
    fn disorder_and_a_negative_period_are_refused() {
        let events = at(&[(5, 1, 1), (4, 1, 1)]);
        let error = filter(events.as_slice(), SIZE, 1).unwrap_err();
        let (index, t_us, previous_us) = (1, 4, 5);
        assert_eq!(error, FilterError::TimeNotAscending { index, t_us, previous_us });
        let error = filter(at(&[(5, 20, 1)]).as_slice(), SIZE, 1).unwrap_err();
        assert!(matches!(error, FilterError::OutsideGrid { index: 0, x: 20, .. }));
        assert!(filter(at(&[]).as_slice(), SIZE, -1).is_err());
        assert!(filter(at(&[]).as_slice(), SIZE, 1).unwrap().events.is_empty());
    }
}
