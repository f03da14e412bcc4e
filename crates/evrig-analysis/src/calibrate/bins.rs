//! The paper's samples and bins: intervals by mean brightness and brightness change, with a
//! first-passage distribution fitted to each bin.
//!
//! A sample is an event with the interval since the event before it at its pixel and with the
//! frames around its time: (t, x, y, p, mean L, delta L). Bins divide the ranges of mean and
//! change evenly, between the 1 % and the 99 % quantile of each, and are represented by their
//! middle. Intervals of 0 µs and of 1 s or more are left out, as in the published program.

use super::BrightnessSeries;
use super::passage::Passage;
use evrig_core::stats::quantile_sorted;
use serde::{Deserialize, Serialize};

/// Bins along each of the two axes.
pub(super) const N_BINS: usize = 20;
/// A bin with fewer samples is discarded.
const MIN_COUNT: f64 = 50.0;
/// Bound of the intervals, µs.
const MAX_INTERVAL_US: f64 = 1e6;
/// Standard deviations within which ON and OFF count as balanced, and the drift as zero.
const BALANCE_SIGMAS: f64 = 2.0;

/// Distribution of a first-passage time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PassageLaw {
    /// With drift.
    InverseGaussian,
    /// Without drift.
    Levy,
}

/// The fit to one bin: the paper's {mu, sigma, mean L, delta L, N}.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BinFit {
    /// Middle of its range of mean brightness, DN.
    pub mean_dn: f64,
    /// Rate of change of brightness at its middle, DN per µs.
    pub change_dn_per_us: f64,
    /// Samples in it.
    pub n: f64,
    /// Lévy where ON and OFF are balanced.
    pub law: PassageLaw,
    /// Drift with the sign of the more frequent polarity, thresholds per µs; 0 under Lévy.
    pub drift_per_us: f64,
    /// Diffusion, thresholds per square root of µs.
    pub sigma_per_sqrt_us: f64,
}

/// Sufficient statistics of a bin.
#[derive(Debug, Clone, Copy, Default)]
struct BinSums {
    n: f64,
    n_on: f64,
    t: f64,
    inverse_t: f64,
}

/// All samples as sums by tile and bin, so that tiles can be resampled.
#[derive(Debug, Clone)]
pub(super) struct Bins {
    mean_edges: [f64; 2],
    change_edges: [f64; 2],
    frame_us: f64,
    kept: Vec<usize>,
    tiles: Vec<Vec<(usize, BinSums)>>,
    samples: Vec<(u16, f32)>,
}

struct IntervalSample {
    mean: f64,
    change: f64,
    t: f64,
    on: bool,
    tile: u32,
}

impl Bins {
    pub(super) fn new(brightness: &BrightnessSeries, passages: &[Passage]) -> Self {
        let samples: Vec<IntervalSample> =
            passages.iter().filter_map(|passage| sample(brightness, passage)).collect();
        let range = |of: fn(&IntervalSample) -> f64| {
            let mut values: Vec<f64> = samples.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            [quantile_sorted(&values, 0.01), quantile_sorted(&values, 0.99)]
        };
        let (mean_edges, change_edges) = (range(|s| s.mean), range(|s| s.change));
        let times = brightness.times_us();
        let span = times.last().zip(times.first()).map_or(0, |(last, first)| last - first);
        let frame_us = span as f64 / times.len().saturating_sub(1).max(1) as f64;
        let mut bins = Self {
            mean_edges,
            change_edges,
            frame_us,
            kept: Vec::new(),
            tiles: Vec::new(),
            samples: Vec::new(),
        };
        bins.fill(&samples);
        bins
    }

    fn fill(&mut self, samples: &[IntervalSample]) {
        let mut by_tile = std::collections::BTreeMap::<u32, Vec<BinSums>>::new();
        let mut all = vec![BinSums::default(); N_BINS * N_BINS];
        for sample in samples {
            let row = place(sample.mean, self.mean_edges);
            let column = place(sample.change, self.change_edges);
            let Some((row, column)) = row.zip(column) else { continue };
            let bin = row * N_BINS + column;
            self.samples.push((bin as u16, sample.t as f32));
            let tile =
                by_tile.entry(sample.tile).or_insert_with(|| vec![BinSums::default(); all.len()]);
            for sums in [&mut tile[bin], &mut all[bin]] {
                sums.n += 1.0;
                sums.n_on += f64::from(u8::from(sample.on));
                sums.t += sample.t;
                sums.inverse_t += 1.0 / sample.t;
            }
        }
        self.kept = (0..all.len()).filter(|&bin| all[bin].n >= MIN_COUNT).collect();
        let filled = |tile: Vec<BinSums>| tile.into_iter().enumerate().filter(|(_, s)| s.n > 0.0);
        self.tiles = by_tile.into_values().map(|tile| filled(tile).collect()).collect();
    }

    pub(super) fn n_tiles(&self) -> usize {
        self.tiles.len()
    }

    /// Samples in the bins that are kept.
    pub(super) fn n_samples(&self) -> u64 {
        let is_kept = |bin: &u16| self.kept.binary_search(&usize::from(*bin)).is_ok();
        self.samples.iter().filter(|(bin, _)| is_kept(bin)).count() as u64
    }

    /// Fits of the kept bins with tile i weighted by `weights[i]`.
    pub(super) fn fit(&self, weights: &[f64]) -> Vec<BinFit> {
        let mut all = vec![BinSums::default(); N_BINS * N_BINS];
        for (tile, &weight) in self.tiles.iter().zip(weights) {
            for (bin, sums) in tile {
                all[*bin].add(sums, weight);
            }
        }
        let middle = |edges: [f64; 2], i: usize| {
            edges[0] + (i as f64 + 0.5) / N_BINS as f64 * (edges[1] - edges[0])
        };
        let fit = |&bin: &usize| {
            let mean_dn = middle(self.mean_edges, bin / N_BINS);
            let change_dn_per_us = middle(self.change_edges, bin % N_BINS) / self.frame_us;
            all[bin].fit(mean_dn, change_dn_per_us)
        };
        self.kept.iter().filter_map(fit).collect()
    }

    /// Intervals (µs) of the `n` fullest kept bins with different brightness change, each with its
    /// index in the result of [`Bins::fit`].
    pub(super) fn fullest(&self, n: usize) -> Vec<(usize, Vec<f64>)> {
        let count =
            |bin: usize| self.samples.iter().filter(|(b, _)| usize::from(*b) == bin).count();
        let mut order: Vec<(usize, usize, usize)> =
            self.kept.iter().enumerate().map(|(i, &bin)| (count(bin), i, bin)).collect();
        order.sort_unstable_by(|a, b| b.cmp(a));
        let mut taken: Vec<(usize, usize)> = Vec::new();
        for (_, i, bin) in order {
            if taken.len() < n && taken.iter().all(|(_, other)| other % N_BINS != bin % N_BINS) {
                taken.push((i, bin));
            }
        }
        let of = |bin: usize| {
            let mine = self.samples.iter().filter(|(b, _)| usize::from(*b) == bin);
            mine.map(|(_, t)| f64::from(*t)).collect()
        };
        taken.into_iter().map(|(i, bin)| (i, of(bin))).collect()
    }
}

impl BinSums {
    fn add(&mut self, other: &Self, weight: f64) {
        self.n += weight * other.n;
        self.n_on += weight * other.n_on;
        self.t += weight * other.t;
        self.inverse_t += weight * other.inverse_t;
    }

    /// Maximum likelihood (Tweedie 1957): mean = sample mean and 1/shape = mean(1/t) - 1/mean;
    /// Lévy's scale = 1 / mean(1/t). The threshold is 1: mu = 1/mean, sigma^2 = 1/shape.
    fn fit(&self, mean_dn: f64, change_dn_per_us: f64) -> Option<BinFit> {
        if self.n < 2.0 {
            return None;
        }
        let is_balanced = (2.0 * self.n_on - self.n).abs() < BALANCE_SIGMAS * self.n.sqrt();
        let sign = if 2.0 * self.n_on >= self.n { 1.0 } else { -1.0 };
        let (mean_t, mean_inverse) = (self.t / self.n, self.inverse_t / self.n);
        let (law, drift_per_us, variance) = if is_balanced {
            (PassageLaw::Levy, 0.0, mean_inverse)
        } else {
            (PassageLaw::InverseGaussian, sign / mean_t, (mean_inverse - 1.0 / mean_t).max(0.0))
        };
        let sigma_per_sqrt_us = variance.sqrt();
        Some(BinFit { mean_dn, change_dn_per_us, n: self.n, law, drift_per_us, sigma_per_sqrt_us })
    }
}

fn sample(brightness: &BrightnessSeries, passage: &Passage) -> Option<IntervalSample> {
    let t = (passage.end_us - passage.start_us) as f64;
    if !(t > 0.0 && t < MAX_INTERVAL_US) {
        return None;
    }
    // An event at a frame's time belongs to the interval before it.
    let after = brightness.times_us().partition_point(|&frame| frame < passage.end_us).max(1);
    let series = brightness.series(passage.slot as usize);
    let (before, after) = (*series.get(after - 1)?, *series.get(after)?);
    Some(IntervalSample {
        mean: 0.5 * f64::from(before + after),
        change: f64::from(after) - f64::from(before),
        t,
        on: passage.on,
        tile: brightness.tile(brightness.pixels()[passage.slot as usize]),
    })
}

/// The bin of a value between two ends.
fn place(value: f64, [low, high]: [f64; 2]) -> Option<usize> {
    let position = (value - low) / (high - low) * N_BINS as f64;
    let is_inside = (0.0..=N_BINS as f64).contains(&position);
    is_inside.then(|| (position as usize).min(N_BINS - 1))
}
