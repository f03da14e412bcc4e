//! Passages from one event of a pixel to its next, in the order of the pixels.

use super::BrightnessSeries;
use super::brightness::TileSubset;
use evrig_core::event::EventSlice;

/// A first passage: V starts at 0 with the event before and ends at a barrier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Passage {
    /// Number of the usable pixel.
    pub(super) slot: u32,
    /// Time of the event before, µs.
    pub(super) start_us: i64,
    /// Time of the event, µs; may equal the start.
    pub(super) end_us: i64,
    /// Whether the event is ON.
    pub(super) on: bool,
}

/// All passages of a subset's usable pixels between the first and last frame, by pixel, then time.
pub(super) fn passages(
    brightness: &BrightnessSeries,
    events: EventSlice<'_>,
    part: TileSubset,
) -> Vec<Passage> {
    let (first, last) = match brightness.times_us() {
        [first, .., last] => (*first, *last),
        _ => return Vec::new(),
    };
    let size = brightness.size();
    let mut slots = vec![u32::MAX; size.n_pixels()];
    for (slot, &pixel) in brightness.pixels().iter().enumerate() {
        if brightness.part(pixel) == part {
            slots[pixel as usize] = slot as u32;
        }
    }
    let mut before: Vec<Option<i64>> = vec![None; brightness.pixels().len()];
    let mut found = Vec::new();
    for event in events.iter() {
        if event.t <= first || event.t > last || !size.contains(event.x, event.y) {
            continue;
        }
        let slot = slots[size.index(event.x, event.y)];
        let Some(before) = before.get_mut(slot as usize) else { continue };
        if let Some(start_us) = before.replace(event.t) {
            found.push(Passage { slot, start_us, end_us: event.t, on: event.on });
        }
    }
    // The sort is stable: a pixel's passages stay in time.
    found.sort_by_key(|passage| passage.slot);
    found
}
