//! From hits in pixel order to events in time order.

use super::sequence::FrameSpan;
use evrig_core::event::Events;
use evrig_core::geometry::Size;

/// A threshold crossing within an interval: from the highest bit the µs after the interval's start
/// (1..=span), whether ON, and the row-major number of the pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Crossing(u64);

impl Crossing {
    const ON: u64 = 1 << 32;

    /// A crossing `offset_us` after the start of an interval of `span_us`. It carries the next
    /// whole microsecond, so that it lies after the interval's first frame and not after its last.
    #[inline]
    pub(super) fn new(pixel: u32, offset_us: f64, span_us: u32, on: bool) -> Self {
        // Not `ceil`, which is a call where the processor is not known to round.
        let below = offset_us as u32;
        let whole = (below + u32::from(f64::from(below) < offset_us)).clamp(1, span_us);
        Self((u64::from(whole) << 33) | (u64::from(on) * Self::ON) | u64::from(pixel))
    }

    fn offset_us(self) -> u32 {
        (self.0 >> 33) as u32
    }

    const fn on(self) -> bool {
        self.0 & Self::ON != 0
    }

    const fn pixel(self) -> u32 {
        self.0 as u32
    }

    /// Time, then pixel.
    const fn order(self) -> u64 {
        self.0 & !Self::ON
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
}

impl EventMerger {
    /// Appends the hits of all blocks, each pixel's as they happened, to `out` in ascending time;
    /// within a microsecond by row, then column, and within a pixel as they happened.
    pub(super) fn merge<'a>(
        &mut self,
        blocks: impl Iterator<Item = &'a [Crossing]> + Clone,
        size: Size,
        interval: FrameSpan,
        out: &mut Events,
    ) {
        self.sort(blocks, interval.span_us);
        sort_within_microseconds(&mut self.hits);
        let rows = RowDivision::new(size);
        out.extend_by_columns(
            &self.hits,
            |hit| interval.start_us + i64::from(hit.offset_us()),
            |hit| rows.column(hit.pixel()),
            |hit| rows.row(hit.pixel()),
            |hit| hit.on(),
        );
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

/// Puts hits in ascending time into the order of pixels within a microsecond.
fn sort_within_microseconds(hits: &mut [Crossing]) {
    let mut start = 0;
    // Blocks give almost all hits in the order of pixels: few microseconds are to be sorted.
    while let Some(at) = hits[start..].windows(2).position(|pair| pair[1].order() < pair[0].order())
    {
        let t_us = hits[start + at].offset_us();
        let low = hits[..start + at].iter().rposition(|hit| hit.offset_us() < t_us);
        let low = low.map_or(0, |before| before + 1);
        let n = hits[low..].partition_point(|hit| hit.offset_us() == t_us);
        hits[low..low + n].sort_by_key(|hit| hit.pixel());
        start = low + n;
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
        sorted.resize(n_hits, Crossing(0));
        for block in blocks {
            for &hit in block {
                let place = &mut counts[self.of(hit)];
                sorted[*place as usize] = hit;
                *place += 1;
            }
        }
    }
}

/// Division of row-major pixel numbers by the width, as a multiplication.
#[derive(Debug, Clone, Copy)]
struct RowDivision {
    width: u32,
    /// 2^48 / width, rounded up: pixel numbers below 2^16 widths err by less than 1 / width, which
    /// is the least distance of a quotient from the next row.
    per_width: u64,
}

impl RowDivision {
    fn new(size: Size) -> Self {
        Self { width: size.width.into(), per_width: (1 << 48) / u64::from(size.width).max(1) + 1 }
    }

    #[inline]
    fn row(self, pixel: u32) -> u16 {
        ((u64::from(pixel) * self.per_width) >> 48) as u16
    }

    #[inline]
    fn column(self, pixel: u32) -> u16 {
        (pixel - u32::from(self.row(pixel)) * self.width) as u16
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
            let rows = RowDivision::new(size);
            for pixel in spots.chain([n_pixels - 1]) {
                let (x, y) = (rows.column(pixel as u32), rows.row(pixel as u32));
                assert!(x < width && size.index(x, y) as u64 == pixel, "{pixel} of {width}");
            }
        }
    }

    #[test]
    fn hits_of_a_microsecond_are_put_in_the_order_of_pixels_and_within_one_as_they_happened() {
        let hit = |pixel, t, on| Crossing::new(pixel, t, 100, on);
        let hits = [(5, 3.0), (2, 3.0), (7, 3.0), (2, 3.0), (9, 3.5), (1, 4.0), (0, 4.0)];
        let hits: Vec<Crossing> =
            hits.iter().enumerate().map(|(i, &(pixel, t))| hit(pixel, t, i < 2)).collect();
        let out = merged(&hits, 100);
        let found: Vec<(u16, bool)> = out.as_slice().iter().map(|e| (e.x, e.on)).collect();
        let later = [(0, false), (1, false), (9, false)];
        let expected = [&[(2, true), (2, false), (5, true), (7, false)][..], &later].concat();
        assert_eq!(found, expected);
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
