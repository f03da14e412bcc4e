//! From hits in pixel order to events in time order.

use super::sequence::Interval;
use crate::event::Events;
use crate::geometry::Size;

/// A threshold crossing within an interval, eight bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Hit {
    /// µs after the interval's start, 1..=span, and in the lowest bit whether On.
    time_and_side: u32,
    /// Row-major number of the pixel.
    pixel: u32,
}

impl Hit {
    /// A crossing `offset_us` after the start of an interval of `span_us`. It carries the next
    /// whole microsecond, so that it lies after the interval's first frame and not after its last.
    #[inline]
    pub(super) fn new(pixel: u32, offset_us: f64, span_us: u32, on: bool) -> Self {
        let whole = (offset_us.ceil() as u32).clamp(1, span_us);
        Self { time_and_side: whole << 1 | u32::from(on), pixel }
    }

    fn offset_us(self) -> u32 {
        self.time_and_side >> 1
    }
}

/// Widest table of counters in a pass of the sort: 2^16 microseconds.
const DIGIT_BITS: u32 = 16;

/// Room for sorting, kept from interval to interval.
#[derive(Debug, Default)]
pub(super) struct Merger {
    hits: Vec<Hit>,
    spare: Vec<Hit>,
    counts: Vec<u32>,
}

impl Merger {
    /// Appends the hits of all blocks, given in pixel order, to `out` in ascending time;
    /// within a microsecond by row, then column, and within a pixel as they happened.
    pub(super) fn merge<'a>(
        &mut self,
        blocks: impl Iterator<Item = &'a [Hit]>,
        size: Size,
        interval: Interval,
        out: &mut Events,
    ) {
        self.hits.clear();
        blocks.for_each(|block| self.hits.extend_from_slice(block));
        self.sort(interval.span_us);
        let width = u32::from(size.width);
        out.extend(self.hits.iter().map(|hit| crate::event::Event {
            t: interval.start_us + i64::from(hit.offset_us()),
            x: (hit.pixel % width) as u16,
            y: (hit.pixel / width) as u16,
            on: hit.time_and_side & 1 == 1,
        }));
    }

    /// Stable sort by time: one counting pass for usual frame intervals, two for long ones.
    fn sort(&mut self, span_us: u32) {
        let n_counters = (span_us as usize + 1).min(1 << DIGIT_BITS);
        if self.hits.len() < n_counters / 64 {
            return self.hits.sort_by_key(|hit| hit.offset_us());
        }
        self.pass(n_counters, 0);
        if span_us >> DIGIT_BITS > 0 {
            self.pass(1 << DIGIT_BITS, DIGIT_BITS);
        }
    }

    fn pass(&mut self, n_counters: usize, shift: u32) {
        let digit = |hit: &Hit| ((hit.offset_us() >> shift) & ((1 << DIGIT_BITS) - 1)) as usize;
        self.counts.clear();
        self.counts.resize(n_counters, 0);
        self.hits.iter().for_each(|hit| self.counts[digit(hit)] += 1);
        let mut place = 0;
        for count in &mut self.counts {
            place += std::mem::replace(count, place);
        }
        self.spare.resize(self.hits.len(), Hit { time_and_side: 0, pixel: 0 });
        for hit in &self.hits {
            let place = &mut self.counts[digit(hit)];
            self.spare[*place as usize] = *hit;
            *place += 1;
        }
        std::mem::swap(&mut self.hits, &mut self.spare);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn merged(hits: &[Hit], span_us: u32) -> Events {
        let mut out = Events::new();
        let interval =
            Interval { index: 1, start_us: 1_700_000_000_000_000, span_us, brightest: 0.0 };
        Merger::default().merge([hits].into_iter(), Size::new(100, 100), interval, &mut out);
        out
    }

    #[test]
    fn counting_sorts_as_a_stable_sort_does_for_short_and_long_intervals() {
        for span_us in [1, 50, 8_333, 65_535, 65_536, 1_000_000, (1 << 31) - 1] {
            let n = 9_000;
            let time = |i: u32| 1.0 + f64::from(i.wrapping_mul(2_654_435_761) % span_us);
            let hits: Vec<Hit> =
                (0..n).map(|i| Hit::new(i, time(i) - 0.5, span_us, i % 3 == 0)).collect();
            let mut expected: Vec<u32> = (0..n).collect();
            expected.sort_by(|&a, &b| time(a).total_cmp(&time(b)));
            let out = merged(&hits, span_us);
            let pixels: Vec<u32> = out
                .as_slice()
                .iter()
                .map(|event| u32::from(event.y) * 100 + u32::from(event.x))
                .collect();
            assert_eq!(pixels, expected, "span {span_us}");
            assert_eq!(out.as_slice().first_disorder(), None);
        }
    }

    #[test]
    fn a_hit_carries_the_next_whole_microsecond_of_its_interval() {
        let hits: Vec<Hit> =
            [0.0, 0.3, 1.0, 7.2, 8.0, 8.4].iter().map(|&t| Hit::new(3, t, 8, true)).collect();
        let out = merged(&hits, 8);
        let offsets: Vec<i64> =
            out.as_slice().t.iter().map(|t| t - 1_700_000_000_000_000).collect();
        assert_eq!(offsets, [1, 1, 1, 8, 8, 8]);
    }
}
