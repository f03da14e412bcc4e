//! From hits in pixel order to events in time order.

use super::sequence::FrameSpan;
use evrig_core::event::{EventSlice, Events};
use evrig_core::geometry::Size;

/// A threshold crossing within an interval, eight bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Crossing {
    /// µs after the interval's start, 1..=span, and in the lowest bit whether ON.
    time_and_side: u32,
    /// Row-major number of the pixel.
    pixel: u32,
}

impl Crossing {
    /// A crossing `offset_us` after the start of an interval of `span_us`. It carries the next
    /// whole microsecond, so that it lies after the interval's first frame and not after its last.
    #[inline]
    pub(super) fn new(pixel: u32, offset_us: f64, span_us: u32, on: bool) -> Self {
        // Not `ceil`, which is a call where the processor is not known to round.
        let below = offset_us as u32;
        let whole = (below + u32::from(f64::from(below) < offset_us)).clamp(1, span_us);
        Self { time_and_side: whole << 1 | u32::from(on), pixel }
    }

    fn offset_us(self) -> u32 {
        self.time_and_side >> 1
    }
}

/// Widest table of counters in a pass of the sort: 2^16 microseconds.
const DIGIT_BITS: u32 = 16;

/// Buffers for sorting, kept from interval to interval.
#[derive(Debug, Default)]
pub(super) struct EventMerger {
    hits: Vec<Crossing>,
    spare: Vec<Crossing>,
    counts: Vec<u32>,
    columns: MergedColumns,
}

/// Events of an interval, a column each.
#[derive(Debug, Default)]
struct MergedColumns {
    t: Vec<i64>,
    x: Vec<u16>,
    y: Vec<u16>,
    on: Vec<bool>,
}

impl EventMerger {
    /// Appends the hits of all blocks, given in pixel order, to `out` in ascending time;
    /// within a microsecond by row, then column, and within a pixel as they happened.
    pub(super) fn merge<'a>(
        &mut self,
        blocks: impl Iterator<Item = &'a [Crossing]> + Clone,
        size: Size,
        interval: FrameSpan,
        out: &mut Events,
    ) {
        self.sort(blocks, interval.span_us);
        self.columns.fill(&self.hits, size, interval.start_us);
        let MergedColumns { t, x, y, on } = &self.columns;
        out.extend_from_slice(EventSlice { t, x, y, on });
    }

    /// Stable sort by time: one counting pass for usual frame intervals, two for long ones.
    fn sort<'a>(&mut self, blocks: impl Iterator<Item = &'a [Crossing]> + Clone, span_us: u32) {
        let n_hits = blocks.clone().map(<[Crossing]>::len).sum();
        let n_counters = (span_us as usize + 1).min(1 << DIGIT_BITS);
        if n_hits < n_counters / 64 {
            self.hits.clear();
            blocks.for_each(|block| self.hits.extend_from_slice(block));
            return self.hits.sort_by_key(|hit| hit.offset_us());
        }
        let low = RadixPass { n_counters, shift: 0 };
        low.sort(blocks, n_hits, &mut self.hits, &mut self.counts);
        if span_us >> DIGIT_BITS > 0 {
            let high = RadixPass { n_counters: 1 << DIGIT_BITS, shift: DIGIT_BITS };
            let blocks = std::iter::once(self.hits.as_slice());
            high.sort(blocks, n_hits, &mut self.spare, &mut self.counts);
            std::mem::swap(&mut self.hits, &mut self.spare);
        }
    }
}

/// The bits of the time that a counting pass looks at.
struct RadixPass {
    n_counters: usize,
    shift: u32,
}

impl RadixPass {
    #[inline]
    fn of(&self, hit: Crossing) -> usize {
        ((hit.offset_us() >> self.shift) & ((1 << DIGIT_BITS) - 1)) as usize
    }

    /// Puts the hits into the order of this digit; equal ones keep theirs.
    fn sort<'a>(
        &self,
        blocks: impl Iterator<Item = &'a [Crossing]> + Clone,
        n_hits: usize,
        sorted: &mut Vec<Crossing>,
        counts: &mut Vec<u32>,
    ) {
        counts.clear();
        counts.resize(self.n_counters, 0);
        for block in blocks.clone() {
            block.iter().for_each(|&hit| counts[self.of(hit)] += 1);
        }
        let mut place = 0;
        for count in counts.iter_mut() {
            place += std::mem::replace(count, place);
        }
        sorted.resize(n_hits, Crossing { time_and_side: 0, pixel: 0 });
        for block in blocks {
            for &hit in block {
                let place = &mut counts[self.of(hit)];
                sorted[*place as usize] = hit;
                *place += 1;
            }
        }
    }
}

impl MergedColumns {
    /// One column after another, so that each is filled several events at a time.
    fn fill(&mut self, hits: &[Crossing], size: Size, start_us: i64) {
        let width = u32::from(size.width);
        // The middle of a pixel over the width lies 1/2w from the next row: f64 cannot err, and
        // is faster than a division of integers.
        let per_width = 1.0 / f64::from(width);
        let row = move |hit: &Crossing| ((f64::from(hit.pixel) + 0.5) * per_width) as u32;
        self.t.clear();
        self.t.extend(hits.iter().map(|hit| start_us + i64::from(hit.offset_us())));
        self.y.clear();
        self.y.extend(hits.iter().map(|hit| row(hit) as u16));
        self.x.clear();
        self.x.extend(hits.iter().map(|hit| (hit.pixel - row(hit) * width) as u16));
        self.on.clear();
        self.on.extend(hits.iter().map(|hit| hit.time_and_side & 1 == 1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn merged(hits: &[Crossing], span_us: u32) -> Events {
        let mut out = Events::new();
        let interval =
            FrameSpan { index: 1, start_us: 1_700_000_000_000_000, span_us, brightest: 0.0 };
        EventMerger::default().merge([hits].into_iter(), Size::new(100, 100), interval, &mut out);
        out
    }

    #[test]
    fn counting_sorts_as_a_stable_sort_does_for_short_and_long_intervals() {
        for span_us in [1, 50, 8_333, 65_535, 65_536, 1_000_000, (1 << 31) - 1] {
            let n = 9_000;
            let time = |i: u32| 1.0 + f64::from(i.wrapping_mul(2_654_435_761) % span_us);
            let hits: Vec<Crossing> =
                (0..n).map(|i| Crossing::new(i, time(i) - 0.5, span_us, i % 3 == 0)).collect();
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
    fn every_pixel_of_any_width_finds_its_row_and_column() {
        for width in [1_u16, 3, 346, 692, 65_535] {
            let size = Size::new(width, u16::MAX);
            let n_pixels = size.n_pixels() as u64;
            let w = u64::from(width);
            let spots = (0..n_pixels / w).step_by(997).flat_map(|y| [y * w, y * w + w - 1]);
            let hits: Vec<Crossing> = spots
                .chain([n_pixels - 1])
                .map(|pixel| Crossing::new(pixel as u32, 1.0, 1, true))
                .collect();
            let mut columns = MergedColumns::default();
            columns.fill(&hits, size, 0);
            for (i, hit) in hits.iter().enumerate() {
                assert_eq!(size.index(columns.x[i], columns.y[i]), hit.pixel as usize);
                assert!(columns.x[i] < width);
            }
        }
    }

    #[test]
    fn a_hit_carries_the_next_whole_microsecond_of_its_interval() {
        let hits: Vec<Crossing> =
            [0.0, 0.3, 1.0, 7.2, 8.0, 8.4].iter().map(|&t| Crossing::new(3, t, 8, true)).collect();
        let out = merged(&hits, 8);
        let offsets: Vec<i64> =
            out.as_slice().t.iter().map(|t| t - 1_700_000_000_000_000).collect();
        assert_eq!(offsets, [1, 1, 1, 8, 8, 8]);
    }
}
