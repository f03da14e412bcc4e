//! One pass over a stream: the counts and intervals of all measures.

use super::interval_bins::{Binner, N_FINE};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Time blocks of the cluster bootstrap.
pub(super) const N_BLOCKS: usize = 40;
/// Half bins of the rate curve: 240 bins of two halves, six bins per time block.
pub(super) const N_HALF_BINS: usize = N_BLOCKS * HALF_BINS_PER_BLOCK;
const HALF_BINS_PER_BLOCK: usize = 12;
/// Largest side of a tile, pixels.
const LARGEST_TILE: usize = 16;
/// With fewer tiles, their side is halved.
const ENOUGH_TILES: usize = 36;

/// Clusters of window and grid, the same for both streams.
pub(super) struct ClusterLayout {
    pub(super) size: Size,
    pub(super) window: [i64; 2],
    /// Tile of each pixel, [`OUTSIDE`] for pixels outside the region.
    pub(super) tile_of: Vec<u32>,
    /// Pixels of the region in each tile.
    pub(super) tile_pixels: Vec<f64>,
}

pub(super) const OUTSIDE: u32 = u32::MAX;

impl ClusterLayout {
    /// `None` for an empty region.
    pub(super) fn new(size: Size, window: [i64; 2], region: Option<&[bool]>) -> Option<Self> {
        let mut side = LARGEST_TILE;
        loop {
            let (tile_of, tile_pixels) = tiles(size, region, side);
            if tile_pixels.is_empty() {
                return None;
            }
            if tile_pixels.len() >= ENOUGH_TILES || side == 1 {
                return Some(Self { size, window, tile_of, tile_pixels });
            }
            side /= 2;
        }
    }

    pub(super) fn n_tiles(&self) -> usize {
        self.tile_pixels.len()
    }

    pub(super) fn n_region_pixels(&self) -> u64 {
        self.tile_pixels.iter().sum::<f64>() as u64
    }

    pub(super) fn half_bin(&self, t: i64) -> usize {
        let [start, end] = self.window;
        ((t - start) * N_HALF_BINS as i64 / (end - start)) as usize
    }

    /// The time block of a time in the window.
    pub(super) fn block(&self, t: i64) -> usize {
        self.half_bin(t) / HALF_BINS_PER_BLOCK
    }

    /// Events in the region: pixel index and index in the slice.
    pub(super) fn in_region<'b>(
        &'b self,
        events: EventSlice<'b>,
    ) -> impl Iterator<Item = (usize, usize)> + 'b {
        let pixels = events.x.iter().zip(events.y).map(|(&x, &y)| self.size.index(x, y));
        pixels.enumerate().filter(|&(_, p)| self.tile_of[p] != OUTSIDE).map(|(i, p)| (p, i))
    }
}

fn tiles(size: Size, region: Option<&[bool]>, side: usize) -> (Vec<u32>, Vec<f64>) {
    let width = size.width as usize;
    let columns = width.div_ceil(side);
    let square = |p: usize| p / width / side * columns + p % width / side;
    let is_in = |p: usize| region.is_none_or(|region| region[p]);
    let mut numbers = vec![OUTSIDE; columns * (size.height as usize).div_ceil(side)];
    let mut n_pixels = Vec::new();
    let mut tile_of = vec![OUTSIDE; size.n_pixels()];
    for p in (0..size.n_pixels()).filter(|&p| is_in(p)) {
        let number = &mut numbers[square(p)];
        if *number == OUTSIDE {
            *number = n_pixels.len() as u32;
            n_pixels.push(0.0);
        }
        tile_of[p] = *number;
        n_pixels[*number as usize] += 1.0;
    }
    (tile_of, n_pixels)
}

/// Fixed-point unit of summed inverses.
const INVERSE_UNIT: u64 = 1 << 62;

/// Sufficient statistics of a tile's intervals. Intervals of 0 µs (two events with one stamp) have
/// no likelihood and are counted separately. Sums are integers, hence independent of the order.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct IntervalSums {
    pub(super) n: u64,
    pub(super) n_zero: u64,
    sum_us: u64,
    inverses: u128,
}

impl IntervalSums {
    fn take(&mut self, interval_us: u64) {
        if interval_us == 0 {
            self.n_zero += 1;
        } else {
            self.n += 1;
            self.sum_us += interval_us;
            self.inverses += u128::from(INVERSE_UNIT / interval_us);
        }
    }

    /// Sum of the intervals, µs.
    pub(super) fn sum(&self) -> f64 {
        self.sum_us as f64
    }

    /// Sum of the intervals' inverses, 1/µs.
    pub(super) fn sum_of_inverses(&self) -> f64 {
        self.inverses as f64 / INVERSE_UNIT as f64
    }
}

/// Counts and intervals of a stream.
pub(super) struct StreamProfile {
    /// Events in window and region.
    pub(super) n: u64,
    /// Events of each pixel by polarity, row-major.
    pub(super) on: Vec<u32>,
    pub(super) off: Vec<u32>,
    /// Events of each half bin of time by polarity.
    pub(super) on_over_time: Vec<u64>,
    pub(super) off_over_time: Vec<u64>,
    /// Intervals in fine bins, tile after tile.
    histograms: Vec<u32>,
    pub(super) interval_sums: Vec<IntervalSums>,
}

impl StreamProfile {
    /// Of events in order of time, on the grid and within the window.
    pub(super) fn of(events: EventSlice<'_>, layout: &ClusterLayout) -> Self {
        const NEVER: i64 = -1;
        let n_pixels = layout.size.n_pixels();
        let mut profile = Self {
            n: 0,
            on: vec![0; n_pixels],
            off: vec![0; n_pixels],
            on_over_time: vec![0; N_HALF_BINS],
            off_over_time: vec![0; N_HALF_BINS],
            histograms: vec![0; layout.n_tiles() * N_FINE],
            interval_sums: vec![IntervalSums::default(); layout.n_tiles()],
        };
        let mut last = vec![NEVER; n_pixels];
        let binner = Binner::new();
        for (pixel, i) in layout.in_region(events) {
            let (t, on) = (events.t[i], events.on[i]);
            let bin = layout.half_bin(t);
            if on {
                profile.on[pixel] += 1;
                profile.on_over_time[bin] += 1;
            } else {
                profile.off[pixel] += 1;
                profile.off_over_time[bin] += 1;
            }
            profile.n += 1;
            let since_start = t - layout.window[0];
            let before = std::mem::replace(&mut last[pixel], since_start);
            if before != NEVER {
                let tile = layout.tile_of[pixel] as usize;
                profile.take_interval(tile, since_start - before, binner);
            }
        }
        profile
    }

    fn take_interval(&mut self, tile: usize, interval_us: i64, binner: Binner) {
        self.histograms[tile * N_FINE + binner.bin(interval_us)] += 1;
        self.interval_sums[tile].take(interval_us.unsigned_abs());
    }

    /// Events of a pixel.
    pub(super) fn count(&self, pixel: usize) -> u64 {
        u64::from(self.on[pixel]) + u64::from(self.off[pixel])
    }

    /// Interval histogram of a tile, in fine bins.
    pub(super) fn histogram(&self, tile: usize) -> &[u32] {
        &self.histograms[tile * N_FINE..(tile + 1) * N_FINE]
    }

    /// Interval histogram of all tiles.
    pub(super) fn total_histogram(&self) -> Vec<f64> {
        let mut total = vec![0.0; N_FINE];
        for histogram in self.histograms.chunks_exact(N_FINE) {
            total.iter_mut().zip(histogram).for_each(|(sum, &n)| *sum += f64::from(n));
        }
        total
    }

    /// Number of intervals in each tile, including those of 0 µs.
    pub(super) fn intervals_by_tile(&self) -> Vec<f64> {
        self.interval_sums.iter().map(|sums| (sums.n + sums.n_zero) as f64).collect()
    }

    /// Events of each time block: all, and ON.
    pub(super) fn by_block(&self) -> (Vec<f64>, Vec<f64>) {
        let sum = |counts: &[u64]| counts.iter().sum::<u64>() as f64;
        let on: Vec<f64> = self.on_over_time.chunks_exact(HALF_BINS_PER_BLOCK).map(sum).collect();
        let off = self.off_over_time.chunks_exact(HALF_BINS_PER_BLOCK).map(sum);
        (off.zip(&on).map(|(off, on)| off + on).collect(), on)
    }

    /// Sum over the pixels of each tile.
    pub(super) fn sum_by_tile(
        &self,
        layout: &ClusterLayout,
        value: impl Fn(u64) -> f64,
    ) -> Vec<f64> {
        let mut sums = vec![0.0; layout.n_tiles()];
        for (pixel, &tile) in layout.tile_of.iter().enumerate() {
            if tile != OUTSIDE {
                sums[tile as usize] += value(self.count(pixel));
            }
        }
        sums
    }
}
