//! Events as images for viewers.

use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Time of one picture, µs.
pub(super) const WINDOW_US: i64 = 20_000;

/// What happened in a window.
pub(super) struct ExportWindow {
    /// Its end, µs.
    pub(super) end_us: i64,
    /// A byte a pixel: 255 where the last event was On, 0 where it was Off, 128 where there was none.
    pub(super) picture: Vec<u8>,
    /// Events a second, On and Off.
    pub(super) rates_hz: [f64; 2],
}

/// The windows in which there are events, in order. They lie on whole multiples of their length, so that
/// those of two streams coincide.
pub(super) fn windows(events: EventSlice<'_>, size: Size) -> impl Iterator<Item = ExportWindow> {
    let mut start = 0;
    std::iter::from_fn(move || {
        let first = *events.t.get(start)?;
        let end_us = (first.div_euclid(WINDOW_US) + 1) * WINDOW_US;
        let end = start + events.t[start..].partition_point(|t| *t < end_us);
        let part = events.range(start, end);
        start = end;
        let mut picture = vec![128; size.n_pixels()];
        for event in part.iter() {
            picture[size.index(event.x, event.y)] = if event.on { 255 } else { 0 };
        }
        let on = part.count_on();
        let rates_hz = [on, part.len() - on].map(|n| n as f64 / (WINDOW_US as f64 * 1e-6));
        Some(ExportWindow { end_us, picture, rates_hz })
    })
}
