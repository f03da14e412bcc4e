//! Correlation of signed event counts (ON minus OFF) with the change of log intensity between two
//! frames, over the pixels of the region; for each frame interval and pooled over all.
//!
//! Between two frames the signed count times the threshold approximates the change. Pearson's r,
//! independent of the threshold. Error: tiles. Pooling adds the sums of all intervals, so intervals
//! with more contrast have more weight.
//!
//! Insensitive to errors common to frames and events, and to motion within a frame interval that
//! leaves no net change.

use super::ProfilePair;
use super::profile::OUTSIDE;
use super::rate_map::CorrelationSums;
use evrig_core::event::EventSlice;
use evrig_core::stats::Estimate;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Changes of log intensity between frames.
#[derive(Clone, Copy)]
pub struct FrameChanges<'a> {
    /// Mid-exposure times of the frames, µs of the events' clock, ascending.
    pub times_us: &'a [i64],
    /// Fills the row-major slice with ln L(k + 1) - ln L(k) of every pixel; NaN (black,
    /// saturated, not observed) leaves the pixel out. Called once for each k below the
    /// number of frames minus one, from several threads.
    pub change: &'a (dyn Fn(usize, &mut [f32]) + Sync),
}

/// The correlation of both streams.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContrastCorrelation {
    /// Real events, all frame intervals pooled.
    pub real: Estimate,
    /// Simulated events, all frame intervals pooled.
    pub simulated: Estimate,
    /// One entry per frame interval inside the window.
    pub per_interval: Vec<FrameCorrelation>,
}

/// The correlation in one frame interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameCorrelation {
    /// Times of the two frames, µs.
    pub t_us: [i64; 2],
    /// Real events.
    pub real: Estimate,
    /// Simulated events.
    pub simulated: Estimate,
}

pub(super) fn correlate(
    pair: &ProfilePair<'_>,
    real: EventSlice<'_>,
    simulated: EventSlice<'_>,
    frames: FrameChanges<'_>,
) -> ContrastCorrelation {
    let [start, end] = pair.layout.window;
    let times = frames.times_us;
    let inside: Vec<usize> = (1..times.len())
        .filter(|&k| times[k - 1] >= start && times[k] <= end)
        .map(|k| k - 1)
        .collect();
    let sums: Vec<[CorrelationSums; 2]> = inside
        .par_iter()
        .map(|&k| {
            let mut change = vec![f32::NAN; pair.layout.size.n_pixels()];
            (frames.change)(k, &mut change);
            let between = |events: EventSlice<'_>| {
                tile_sums(pair, events.between(times[k], times[k + 1]), &change)
            };
            [between(real), between(simulated)]
        })
        .collect();
    let estimate = |sums: &CorrelationSums| {
        let n_tiles = pair.layout.n_tiles();
        pair.bootstrap.estimate(n_tiles, sums.n(), |w| sums.correlation(w))
    };
    let mut pooled =
        [CorrelationSums::new(pair.layout.n_tiles()), CorrelationSums::new(pair.layout.n_tiles())];
    for [real, simulated] in &sums {
        pooled[0].add(real);
        pooled[1].add(simulated);
    }
    let per_interval = inside.iter().zip(&sums).map(|(&k, [real, simulated])| FrameCorrelation {
        t_us: [times[k], times[k + 1]],
        real: estimate(real),
        simulated: estimate(simulated),
    });
    ContrastCorrelation {
        real: estimate(&pooled[0]),
        simulated: estimate(&pooled[1]),
        per_interval: per_interval.collect(),
    }
}

fn tile_sums(pair: &ProfilePair<'_>, events: EventSlice<'_>, change: &[f32]) -> CorrelationSums {
    let mut signed = vec![0_i32; change.len()];
    for (pixel, i) in pair.layout.in_region(events) {
        signed[pixel] += if events.on[i] { 1 } else { -1 };
    }
    let mut sums = CorrelationSums::new(pair.layout.n_tiles());
    let pixels = pair.layout.tile_of.iter().zip(&signed).zip(change);
    for ((&tile, &signed), &change) in pixels {
        if tile != OUTSIDE && change.is_finite() {
            sums.push(tile as usize, f64::from(signed), f64::from(change));
        }
    }
    sums
}
