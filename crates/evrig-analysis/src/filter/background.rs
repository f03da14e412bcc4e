//! Drops background activity: an event is kept if one of its eight neighbours had an event at most
//! a given time before it. Its own pixel does not count: a hot pixel would support itself. Dropped
//! events do support later ones, so only the first event of an edge is lost (Delbruck, Frame-free
//! dynamic digital vision, 2008).

use super::{DropReason, FilterError, Filtered, keep};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Filters with support from neighbours within `window_us` microseconds, ends included.
///
/// # Errors
/// Events out of order or off the grid; a negative window.
pub fn filter(events: EventSlice<'_>, size: Size, window_us: i64) -> Result<Filtered, FilterError> {
    if window_us < 0 {
        let found = window_us as f64;
        return Err(FilterError::BadSetting { name: "window_us", found, expected: "0 or more" });
    }
    // Padding by one pixel avoids a test for the border.
    let width = size.width as usize;
    let stride = width + 2;
    let mut last = vec![i64::MIN; stride * (size.height as usize + 2)];
    let mut padded = vec![0_u32; size.n_pixels()];
    for (pixel, place) in padded.iter_mut().enumerate() {
        *place = ((pixel / width + 1) * stride + pixel % width + 1) as u32;
    }
    keep(events, size, DropReason::Background, |t, pixel| {
        let place = padded[pixel] as usize;
        let row = |first: usize| {
            let three = &last[first..first + 3];
            three[0].max(three[1]).max(three[2])
        };
        let beside = last[place - 1].max(last[place + 1]);
        let latest = row(place - stride - 1).max(row(place + stride - 1)).max(beside);
        last[place] = t;
        // i64::MIN: the neighbours have not fired yet.
        latest != i64::MIN && latest >= t.saturating_sub(window_us)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::fixture::{SIZE, at, scattered, times};

    #[test]
    fn each_of_the_eight_neighbours_supports_an_event_and_nothing_else_does() {
        for (dx, dy) in (0..5_u16).flat_map(|dx| (0..5_u16).map(move |dy| (dx, dy))) {
            let events = at(&[(0, 8 + dx, 3 + dy), (10, 10, 5)]);
            let is_neighbour = dx.abs_diff(2) <= 1 && dy.abs_diff(2) <= 1 && (dx, dy) != (2, 2);
            let kept = times(&filter(events.as_slice(), SIZE, 10).unwrap().events);
            assert_eq!(kept == [10], is_neighbour, "neighbour at ({dx}, {dy})");
        }
    }

    #[test]
    fn support_ends_with_the_window() {
        let events = at(&[(0, 4, 4), (10, 5, 4), (21, 4, 4)]);
        let filtered = filter(events.as_slice(), SIZE, 10).unwrap();
        assert_eq!(times(&filtered.events), [10]);
        assert_eq!(filtered.tally.dropped[&DropReason::Background], 2);
        assert!(filtered.tally.balances());
    }

    #[test]
    fn a_moving_edge_stays_and_scattered_noise_goes() {
        let mut edge = Vec::new();
        for x in 0..20 {
            edge.extend((0..10).map(|y| (i64::from(x) * 1_000 + i64::from(y), x, y)));
        }
        let kept = filter(at(&edge).as_slice(), SIZE, 1_500).unwrap();
        assert_eq!(kept.tally.n_dropped(), 1, "only the very first has no support");
        let noise = scattered(2_000);
        let kept = filter(noise.as_slice(), SIZE, 20).unwrap();
        assert!(kept.tally.kept * 10 < kept.tally.seen, "{:?}", kept.tally);
    }

    #[test]
    fn corners_of_the_grid_are_pixels_like_others() {
        let events = at(&[(0, 0, 0), (1, 1, 1), (2, 19, 9), (3, 18, 8), (4, 19, 0), (5, 0, 1)]);
        let kept = filter(events.as_slice(), SIZE, 10).unwrap();
        assert_eq!(times(&kept.events), [1, 3, 5]);
    }
}
