//! Drops all events of hot pixels.
//!
//! A pixel is hot when its count over the whole stream is above `factor` times the q-quantile of
//! the counts of all active pixels and above `min_count`. A high quantile (0.99) instead of the
//! median, as textured scenes have busy pixels; the few hot ones do not affect it.
//!
//! The list of hot pixels is returned, so that they can be dropped from the other stream as well.

use super::{DropReason, FilterError, Filtered, keep};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Criterion of a hot pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HotPixelSetting {
    /// Multiple of the quantile's count above which a pixel is hot; above 0.
    pub factor: f64,
    /// Quantile of the counts of active pixels, 0..=1.
    pub quantile: f64,
    /// A pixel with no more events than this is never hot.
    pub min_count: u32,
}

impl Default for HotPixelSetting {
    /// Three times the count of the busiest percent, and more than 20 events.
    fn default() -> Self {
        Self { factor: 3.0, quantile: 0.99, min_count: 20 }
    }
}

/// Finds the hot pixels of a stream and drops their events; also gives their indices, row-major
/// and ascending.
///
/// # Errors
/// Events out of order or off the grid; a setting out of its range.
pub fn filter(
    events: EventSlice<'_>,
    size: Size,
    setting: HotPixelSetting,
) -> Result<(Filtered, Vec<usize>), FilterError> {
    let hot = find(events, size, setting)?;
    Ok((drop_pixels(events, size, &hot)?, hot))
}

/// Drops the events of the given pixels (row-major indices; those off the grid are ignored).
///
/// # Errors
/// Events out of order or off the grid.
pub fn drop_pixels(
    events: EventSlice<'_>,
    size: Size,
    pixels: &[usize],
) -> Result<Filtered, FilterError> {
    let mut is_kept = vec![true; size.n_pixels()];
    for &pixel in pixels {
        if let Some(is_kept) = is_kept.get_mut(pixel) {
            *is_kept = false;
        }
    }
    keep(events, size, DropReason::HotPixel, |_, pixel| is_kept[pixel])
}

fn find(
    events: EventSlice<'_>,
    size: Size,
    setting: HotPixelSetting,
) -> Result<Vec<usize>, FilterError> {
    let HotPixelSetting { factor, quantile, min_count } = setting;
    let bad = |name, found, expected| Err(FilterError::BadSetting { name, found, expected });
    if factor.is_nan() || factor <= 0.0 {
        return bad("factor", factor, "a number above 0");
    }
    if !(0.0..=1.0).contains(&quantile) {
        return bad("quantile", quantile, "0 to 1");
    }
    let mut counts = vec![0_u32; size.n_pixels()];
    for (&x, &y) in events.x.iter().zip(events.y) {
        // Events off the grid are refused when they are filtered.
        if let Some(count) = counts.get_mut(size.index(x, y)) {
            *count += 1;
        }
    }
    let mut active: Vec<u32> = counts.iter().copied().filter(|&n| n > 0).collect();
    let Some(last) = active.len().checked_sub(1) else { return Ok(Vec::new()) };
    let place = (quantile * last as f64).round() as usize;
    let (_, &mut typical, _) = active.select_nth_unstable(place);
    let limit = (factor * f64::from(typical)).max(f64::from(min_count));
    Ok((0..counts.len()).filter(|&pixel| f64::from(counts[pixel]) > limit).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::fixture::{SIZE, at, scattered};
    use evrig_core::event::{Event, Events};

    fn with_two_hot_pixels() -> Events {
        let mut events = scattered(4_000);
        let hot = (0..900_i64).flat_map(|i| [(i, 3, 4), (i, 19, 9)]);
        hot.for_each(|(t, x, y)| events.push(Event { t: t * 100, x, y, on: true }));
        events.sort_by_time();
        events
    }

    #[test]
    fn planted_hot_pixels_are_found_and_only_they_go() {
        let events = with_two_hot_pixels();
        let setting = HotPixelSetting { quantile: 0.9, ..HotPixelSetting::default() };
        let (filtered, hot) = filter(events.as_slice(), SIZE, setting).unwrap();
        assert_eq!(hot, [SIZE.index(3, 4), SIZE.index(19, 9)]);
        assert!(filtered.tally.n_dropped() >= 1_800);
        assert!(filtered.tally.balances());
        let rest = filtered.events.as_slice();
        assert!(rest.iter().all(|e| !hot.contains(&SIZE.index(e.x, e.y))));
        let again = drop_pixels(filtered.events.as_slice(), SIZE, &hot).unwrap();
        assert_eq!(again.tally.n_dropped(), 0);
    }

    #[test]
    fn an_even_scene_has_no_hot_pixel() {
        let events = scattered(4_000);
        let (filtered, hot) = filter(events.as_slice(), SIZE, HotPixelSetting::default()).unwrap();
        assert!(hot.is_empty());
        assert_eq!(filtered.events, events);
    }

    #[test]
    fn few_events_make_no_pixel_hot_and_none_make_none() {
        let few = at(&[(0, 1, 1), (1, 1, 1), (2, 1, 1), (3, 5, 5), (4, 6, 6)]);
        let setting = HotPixelSetting { quantile: 0.0, factor: 1.0, min_count: 3 };
        assert!(filter(few.as_slice(), SIZE, setting).unwrap().1.is_empty());
        assert!(filter(at(&[]).as_slice(), SIZE, setting).unwrap().1.is_empty());
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let none = at(&[]);
        for (factor, quantile) in [(0.0, 0.9), (f64::NAN, 0.9), (3.0, 1.1), (3.0, f64::NAN)] {
            let setting = HotPixelSetting { factor, quantile, min_count: 0 };
            assert!(filter(none.as_slice(), SIZE, setting).is_err());
        }
    }
}
