//! Streams for the filters' tests.

use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;

pub(super) const SIZE: Size = Size::new(20, 10);

/// On events of (time, column, row).
pub(super) fn at(places: &[(i64, u16, u16)]) -> Events {
    places.iter().map(|&(t, x, y)| Event { t, x, y, on: true }).collect()
}

/// Times of the events.
pub(super) fn times(events: &Events) -> Vec<i64> {
    events.as_slice().t.to_vec()
}

/// Events at scattered pixels and times that ascend.
pub(super) fn scattered(n: u64) -> Events {
    let mut t = 0;
    let event = |i: u64| {
        let mixed = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        t += (mixed >> 58) as i64;
        Event {
            t,
            x: (mixed >> 20) as u16 % 20,
            y: (mixed >> 40) as u16 % 10,
            on: i.is_multiple_of(3),
        }
    };
    (0..n).map(event).collect()
}
