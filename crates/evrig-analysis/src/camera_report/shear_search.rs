//! Search for events that follow the frame's start by a delay that is linear in the row.
//!
//! Events are counted by row and phase. For each time per row the rows are shifted against each
//! other and added, and windows of several widths are compared with their surroundings. As in the
//! search for dispersed pulses (subband dedispersion; Magro, Karastergiou et al., MNRAS 417 (2011)
//! 2642), groups of neighbouring rows are added first for few shifts, and the groups then for all:
//! the work is the number of cells times the number of shifts over the size of a group.

use super::chance::excess_z;
use super::frame_fold::FrameFold;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use std::ops::Range;

/// Phase bins of a frame's cycle, at most: a work budget, as the work grows with the square.
const MAX_BINS: f64 = 2_048.0;

/// Narrowest bin, µs.
const MIN_BIN_US: f64 = 20.0;

/// Widths of windows, bins. Broader ones are followed by the surroundings.
const WIDTHS: [usize; 5] = [1, 2, 4, 8, 16];

/// Bins between a window and its surroundings, and of the surroundings to either side.
pub(super) const GUARD_BINS: usize = 16;
pub(super) const SIDE_BINS: usize = 48;

/// Bins beyond either end of the cycle that windows and their surroundings need.
const REACH: usize = GUARD_BINS + SIDE_BINS + WIDTHS[WIDTHS.len() - 1];

/// Windows that are compared with the best one at once.
const BLOCK_BINS: usize = 64;

/// Rows of a group; the work is least near the square root of the number of rows.
const GROUP_ROWS: usize = 16;

/// Counts by row and phase.
pub(super) struct PhaseTable {
    counts: Vec<f32>,
    n_bins: usize,
    n_rows: usize,
    pub(super) bin_us: f64,
}

/// The most significant window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShearedWindow {
    /// Excess over the more populated side, standard errors.
    pub(super) z: f64,
    /// Middle of the window at row 0, µs since the frame's start.
    pub(super) delay_us: f64,
    pub(super) row_us: f64,
    pub(super) width_us: f64,
}

impl PhaseTable {
    /// Counts the events of one polarity. `step_us` is the step of the stamps.
    pub(super) fn new(
        events: EventSlice<'_>,
        size: Size,
        fold: &FrameFold<'_>,
        on: bool,
        step_us: f64,
    ) -> Self {
        let finest = MIN_BIN_US.max(fold.period_us / MAX_BINS).max(step_us);
        let n_bins = ((fold.period_us / finest) as usize).max(1);
        let bin_us = fold.period_us / n_bins as f64;
        let n_rows = usize::from(size.height);
        let mut counts = vec![0.0; n_bins * n_rows];
        fold.visit(events.t, |i, _, since| {
            if events.on[i] == on {
                counts[usize::from(events.y[i]) * n_bins + (since / bin_us) as usize % n_bins] +=
                    1.0;
            }
        });
        Self { counts, n_bins, n_rows, bin_us }
    }

    /// Windows that are compared: delays, times per row and widths.
    pub(super) fn n_trials(&self) -> f64 {
        (self.n_bins * self.shifts().count() * WIDTHS.len()) as f64
    }

    /// Whether a window with its surroundings fits into the cycle.
    pub(super) fn is_searchable(&self) -> bool {
        self.n_bins > 2 * (GUARD_BINS + SIDE_BINS) + WIDTHS[WIDTHS.len() - 1]
    }

    /// Total shifts over all rows, bins: up to a whole cycle either way.
    fn shifts(&self) -> std::ops::RangeInclusive<i64> {
        -(self.n_bins as i64)..=self.n_bins as i64
    }

    /// The window with the largest excess.
    pub(super) fn best(&self) -> Option<ShearedWindow> {
        let n_groups = self.n_rows.div_ceil(GROUP_ROWS);
        // One step shifts the last row of a group by one bin against the first.
        let coarse_step = (self.n_rows as f64 / GROUP_ROWS as f64).max(1.0);
        let mut groups = vec![0.0_f32; n_groups * self.n_bins];
        let mut line = vec![0.0_f32; self.n_bins];
        let mut sums = Vec::with_capacity(self.n_bins + 2 * REACH + 1);
        let (mut best, mut grouped_for): (Option<ShearedWindow>, Option<i64>) = (None, None);
        for shift in self.shifts() {
            let coarse = (shift as f64 / coarse_step).round() as i64;
            if grouped_for != Some(coarse) {
                self.add_rows(coarse as f64 * coarse_step, &mut groups);
                grouped_for = Some(coarse);
            }
            line.fill(0.0);
            for (group, counts) in groups.chunks_exact(self.n_bins).enumerate() {
                let row = (group * GROUP_ROWS) as f64;
                add_shifted(&mut line, counts, self.shift_of_row(row, shift as f64));
            }
            let scales = [self.bin_us, shift as f64 / self.n_rows as f64];
            best_window(&line, &mut sums, &mut best, scales);
        }
        best
    }

    fn shift_of_row(&self, row: f64, shift: f64) -> usize {
        let bins = (row * shift / self.n_rows as f64).round() as i64;
        bins.rem_euclid(self.n_bins as i64) as usize
    }

    /// Adds the rows of each group, shifted against the group's first row.
    fn add_rows(&self, shift: f64, groups: &mut [f32]) {
        groups.fill(0.0);
        for (row, counts) in self.counts.chunks_exact(self.n_bins).enumerate() {
            let line = &mut groups[row / GROUP_ROWS * self.n_bins..][..self.n_bins];
            add_shifted(line, counts, self.shift_of_row((row % GROUP_ROWS) as f64, shift));
        }
    }

    /// Replaces what is within `half_us` of a line by the mean of its row, so that the next search
    /// finds something else.
    pub(super) fn remove(&mut self, delay_us: f64, row_us: f64, half_us: f64) {
        let n_bins = self.n_bins as i64;
        let half = (half_us / self.bin_us).ceil() as i64 + 1;
        let half = half.min(n_bins / 2 - 1);
        for (row, counts) in self.counts.chunks_exact_mut(self.n_bins).enumerate() {
            let middle = ((delay_us + row_us * row as f64) / self.bin_us).floor() as i64;
            let mean = counts.iter().sum::<f32>() / n_bins as f32;
            for bin in middle - half..=middle + half {
                counts[bin.rem_euclid(n_bins) as usize] = mean;
            }
        }
    }
}

/// Adds `counts`, whose bin `shift` comes first.
fn add_shifted(line: &mut [f32], counts: &[f32], shift: usize) {
    let (head, tail) = counts.split_at(shift);
    let (first, rest) = line.split_at_mut(tail.len());
    first.iter_mut().zip(tail).for_each(|(sum, n)| *sum += n);
    rest.iter_mut().zip(head).for_each(|(sum, n)| *sum += n);
}

/// Compares all windows on a line of bins with the more populated of their two sides.
fn best_window(
    line: &[f32],
    sums: &mut Vec<f64>,
    best: &mut Option<ShearedWindow>,
    [bin_us, bins_per_row]: [f64; 2],
) {
    let n = line.len();
    // Sums from the first bin on, over the cycle and what windows need beyond either end.
    sums.clear();
    let mut sum = 0.0_f64;
    sums.push(sum);
    let [head, tail] = [&line[..REACH], &line[n - REACH..]];
    for count in tail.iter().chain(line).chain(head) {
        sum += f64::from(*count);
        sums.push(sum);
    }
    for width in WIDTHS {
        let windows = SidedWindows::new(sums, n, width);
        for from in (0..n).step_by(BLOCK_BINS) {
            let bins = from..(from + BLOCK_BINS).min(n);
            let least = best.map_or(0.0, |best| best.z);
            if !windows.may_exceed(least, bins.clone()) {
                continue;
            }
            for bin in bins {
                let z = windows.excess(bin);
                if z > best.map_or(0.0, |best| best.z) {
                    *best = Some(ShearedWindow {
                        z,
                        delay_us: (bin as f64 + 0.5 * width as f64) * bin_us,
                        row_us: bins_per_row * bin_us,
                        width_us: width as f64 * bin_us,
                    });
                }
            }
        }
    }
}

/// Sums at both ends of all windows of a width and of their surroundings, by the window's bin.
struct SidedWindows<'a> {
    inside: [&'a [f64]; 2],
    before: [&'a [f64]; 2],
    after: [&'a [f64]; 2],
    ratio: f64,
}

impl<'a> SidedWindows<'a> {
    /// `sums` begins [`REACH`] bins before the first of `n` windows.
    fn new(sums: &'a [f64], n: usize, width: usize) -> Self {
        let at = |offset: usize| &sums[offset..offset + n];
        let after = REACH + width + GUARD_BINS;
        Self {
            inside: [at(REACH), at(REACH + width)],
            before: [at(REACH - GUARD_BINS - SIDE_BINS), at(REACH - GUARD_BINS)],
            after: [at(after), at(after + SIDE_BINS)],
            ratio: width as f64 / SIDE_BINS as f64,
        }
    }

    /// Whether the excess of any of some windows may exceed `least`: the likelihood ratio is never
    /// above Pearson's statistic of the expected number. Without a branch, for vector registers.
    fn may_exceed(&self, least: f64, bins: Range<usize>) -> bool {
        let [inside, before, after] =
            [self.inside, self.before, self.after].map(|ends| ends.map(|sums| &sums[bins.clone()]));
        let bar = least * least * self.ratio;
        let mut may_exceed = false;
        for i in 0..bins.len() {
            let [inside, before, after] =
                [inside, before, after].map(|[from, to]: [&[f64]; 2]| to[i] - from[i]);
            let outside = if before > after { before } else { after };
            let beyond = inside - self.ratio * outside;
            may_exceed |= (beyond > 0.0) & (beyond * beyond > bar * outside);
        }
        may_exceed
    }

    /// Excess of a window over the more populated of its sides, standard errors.
    fn excess(&self, bin: usize) -> f64 {
        let [inside, before, after] =
            [self.inside, self.before, self.after].map(|[from, to]| to[bin] - from[bin]);
        excess_z(inside, before.max(after), self.ratio)
    }
}
