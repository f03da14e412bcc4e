//! Passages: from one event of a pixel to its next, in the order of the pixels.

use super::Light;
use super::light::Part;
use evrig_core::event::EventSlice;

/// One passage: V started at 0 with the event before and met a barrier at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Passage {
    /// Number of the usable pixel.
    pub(super) slot: u32,
    /// Time of the event before, µs.
    pub(super) start_us: i64,
    /// Time of the event, µs; may equal the start.
    pub(super) end_us: i64,
    /// Whether the event is On.
    pub(super) on: bool,
}

/// All passages of usable pixels of a part while there is light, by pixel, then by time.
pub(super) fn passages(light: &Light, events: EventSlice<'_>, part: Part) -> Vec<Passage> {
    let (first, last) = match light.times_us() {
        [first, .., last] => (*first, *last),
        _ => return Vec::new(),
    };
    let size = light.size();
    let mut slots = vec![u32::MAX; size.n_pixels()];
    for (slot, &pixel) in light.pixels().iter().enumerate() {
        if light.part(pixel) == part {
            slots[pixel as usize] = slot as u32;
        }
    }
    let mut before: Vec<Option<i64>> = vec![None; light.pixels().len()];
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
