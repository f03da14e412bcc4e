//! Event-rate maps and their root mean square difference.
//!
//! rate_map rmse = root of the mean over the region's pixels of (r_sim - r_real)^2, r in events
//! per second. Error: tiles. Two streams of one distribution have an rmse above zero,
//! sqrt((r_sim + r_real) / T) for Poisson pixels.

use super::ProfilePair;
use super::profile::{OUTSIDE, StreamProfile};
use evrig_core::geometry::Size;
use evrig_core::stats::{Estimate, dot};
use serde::{Deserialize, Serialize};

/// Events of each pixel in the window, row-major; pixels outside the region hold 0. Divide by the
/// window's length for rates.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Maps {
    /// Grid of the maps; none when read from JSON.
    pub size: Option<Size>,
    /// Real ON events.
    pub real_on: Vec<u32>,
    /// Real OFF events.
    pub real_off: Vec<u32>,
    /// Simulated ON events.
    pub simulated_on: Vec<u32>,
    /// Simulated OFF events.
    pub simulated_off: Vec<u32>,
}

/// Difference of the two rate maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RateMapError {
    /// Root mean square difference of the pixels' rates, events per second and pixel.
    pub rmse_hz: Estimate,
    /// Correlation of the pixels' rates over the region; `null` when a map is flat.
    pub correlation: Estimate,
    /// Mean rate of a real pixel, for scale.
    pub mean_real_hz: f64,
}

pub(super) fn maps(size: Size, real: StreamProfile, simulated: StreamProfile) -> Maps {
    Maps {
        size: Some(size),
        real_on: real.on,
        real_off: real.off,
        simulated_on: simulated.on,
        simulated_off: simulated.off,
    }
}

pub(super) fn error(pair: &ProfilePair<'_>) -> RateMapError {
    let [start, end] = pair.layout.window;
    let seconds = (end - start) as f64 * 1e-6;
    let n_tiles = pair.layout.n_tiles();
    let mut sums = CorrelationSums::new(n_tiles);
    let mut squares = vec![0.0; n_tiles];
    for (pixel, &tile) in pair.layout.tile_of.iter().enumerate().filter(|(_, t)| **t != OUTSIDE) {
        let real = pair.real.count(pixel) as f64 / seconds;
        let simulated = pair.simulated.count(pixel) as f64 / seconds;
        sums.push(tile as usize, simulated, real);
        squares[tile as usize] += (simulated - real).powi(2);
    }
    let n_pixels = pair.layout.n_region_pixels();
    let pixels = &pair.layout.tile_pixels;
    RateMapError {
        rmse_hz: pair
            .bootstrap
            .estimate(n_tiles, n_pixels, |w| (dot(w, &squares) / dot(w, pixels)).sqrt()),
        correlation: pair.bootstrap.estimate(n_tiles, n_pixels, |w| sums.correlation(w)),
        mean_real_hz: pair.real.n as f64 / seconds / n_pixels as f64,
    }
}

/// Sufficient statistics for the correlation of two quantities over the pixels of each tile.
#[derive(Debug, Clone)]
pub(super) struct CorrelationSums {
    n: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
    xx: Vec<f64>,
    yy: Vec<f64>,
    xy: Vec<f64>,
}

impl CorrelationSums {
    pub(super) fn new(n_tiles: usize) -> Self {
        let zeros = vec![0.0; n_tiles];
        Self {
            n: zeros.clone(),
            x: zeros.clone(),
            y: zeros.clone(),
            xx: zeros.clone(),
            yy: zeros.clone(),
            xy: zeros,
        }
    }

    pub(super) fn push(&mut self, tile: usize, x: f64, y: f64) {
        self.n[tile] += 1.0;
        self.x[tile] += x;
        self.y[tile] += y;
        self.xx[tile] += x * x;
        self.yy[tile] += y * y;
        self.xy[tile] += x * y;
    }

    pub(super) fn add(&mut self, other: &Self) {
        let mine =
            [&mut self.n, &mut self.x, &mut self.y, &mut self.xx, &mut self.yy, &mut self.xy];
        let theirs = [&other.n, &other.x, &other.y, &other.xx, &other.yy, &other.xy];
        for (mine, theirs) in mine.into_iter().zip(theirs) {
            mine.iter_mut().zip(theirs).for_each(|(mine, theirs)| *mine += theirs);
        }
    }

    pub(super) fn n(&self) -> u64 {
        self.n.iter().sum::<f64>() as u64
    }

    /// Pearson's correlation with weighted tiles; NaN when either quantity does not vary.
    pub(super) fn correlation(&self, weights: &[f64]) -> f64 {
        let n = dot(weights, &self.n);
        let (x, y) = (dot(weights, &self.x) / n, dot(weights, &self.y) / n);
        let variance_x = dot(weights, &self.xx) / n - x * x;
        let variance_y = dot(weights, &self.yy) / n - y * y;
        if variance_x <= 1e-12 * x * x || variance_y <= 1e-12 * y * y {
            return f64::NAN;
        }
        (dot(weights, &self.xy) / n - x * y) / (variance_x * variance_y).sqrt()
    }
}
