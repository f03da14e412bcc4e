//! Splits a run of events into packets.

use evrig_core::event::EventSlice;

/// An event packet ends once it spans this much time, as DV's own packets do, ...
const EVENT_PACKET_US: i64 = 10_000;

/// ... and holds this many events, below which compression suffers, ...
const MIN_EVENTS: usize = 1 << 13;

/// ... or once it spans a second, so that recordings of few events can be seeked, ...
const MAX_EVENT_PACKET_US: i64 = 1_000_000;

/// ... or holds 512 KiB of events, which stay in a core's cache.
const MAX_EVENTS: usize = 1 << 15;

/// Start and end of each packet.
pub(super) fn cut_into_packets(events: EventSlice<'_>) -> Vec<[usize; 2]> {
    let mut cuts = Vec::new();
    let mut start = 0;
    while start < events.len() {
        let longest = &events.t[start..events.len().min(start + MAX_EVENTS)];
        let since = |t: &i64| t.saturating_sub(longest[0]);
        let few = &longest[..longest.len().min(MIN_EVENTS)];
        let length = match few.iter().position(|t| since(t) >= MAX_EVENT_PACKET_US) {
            Some(length) => length,
            None => {
                let is_later = |t: &i64| since(t) >= EVENT_PACKET_US;
                let more = longest[few.len()..].iter().position(is_later);
                more.map_or(longest.len(), |more| few.len() + more)
            }
        };
        cuts.push([start, start + length]);
        start += length;
    }
    cuts
}
