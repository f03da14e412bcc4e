//! Optics of an event pixel applied to the map.

use super::map::{MapGrid, RadianceMap};
use super::raster::Raster;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use statrs::function::erf::erf;

/// Point-spread function of the event camera relative to the map: a square aperture convolved with
/// a Gaussian, both in DAVIS pixels. The Gaussian adds to the blur of the Pi's optics that the map
/// already has.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PointSpread {
    /// Side of the aperture, pixels.
    pub aperture_px: f64,
    /// Standard deviation of the Gaussian, pixels.
    pub sigma_px: f64,
}

impl PointSpread {
    /// A Gaussian with an aperture of one pixel.
    #[must_use]
    pub const fn of_sigma(sigma_px: f64) -> Self {
        Self { aperture_px: 1.0, sigma_px }
    }

    /// Weights at whole cells for a pixel that is `cells` cells wide; their sum is one.
    fn kernel(self, cells: f64) -> Vec<f32> {
        let (half, sigma) = (self.aperture_px.max(0.0) * cells / 2.0, self.sigma_px.abs() * cells);
        let sigma = sigma.max(0.05);
        let reach = (half + 3.5 * sigma).ceil() as i64;
        let scale = sigma * std::f64::consts::SQRT_2;
        let weight = |i: i64| {
            let i = i as f64;
            if half > 0.0 {
                erf((i + half) / scale) - erf((i - half) / scale)
            } else {
                (-(i / scale).powi(2)).exp()
            }
        };
        let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|weight| (weight / sum) as f32).collect()
    }
}

/// Least share of a pixel's weight that must fall on known cells.
const MIN_KNOWN: f32 = 0.995;

/// The map as pixels of the given width see it; `NaN` where less than [`MIN_KNOWN`] is known.
pub(super) fn blur_map(map: &RadianceMap, spread: PointSpread, pixel_mm: f64) -> RadianceMap {
    let kernel = spread.kernel(pixel_mm / map.grid.cell_mm);
    let known: Vec<f32> =
        map.values().iter().map(|value| f32::from(u8::from(value.is_finite()))).collect();
    let values: Vec<f32> =
        map.values().iter().map(|value| if value.is_finite() { *value } else { 0.0 }).collect();
    let variances: Vec<f32> =
        map.errors().iter().map(|e| if e.is_finite() { e * e } else { 0.0 }).collect();
    let squares: Vec<f32> = kernel.iter().map(|weight| weight * weight).collect();
    let grid = map.grid;
    let light = convolve(&values, grid, &kernel);
    let share = convolve(&known, grid, &kernel);
    let variance = convolve(&variances, grid, &squares);
    let value = |(light, share): (&f32, &f32)| {
        if *share >= MIN_KNOWN { light / share } else { f32::NAN }
    };
    let values = light.iter().zip(&share).map(value).collect();
    RadianceMap::new(grid, values, variance.iter().map(|v| v.max(0.0).sqrt()).collect())
}

/// Natural logarithm of a map relative to white; darker cells are clamped to `least_dn`.
pub(super) fn log_map(map: &RadianceMap, white_dn: f64, least_dn: f64) -> Raster {
    let (white, least) = (white_dn as f32, least_dn as f32);
    let log = |value: &f32| {
        if value.is_nan() { f32::NAN } else { (value.max(least) / white).ln() }
    };
    let values = map.values().par_iter().map(log).collect();
    Raster { width: map.grid.width, height: map.grid.height, values }
}

/// Separable convolution with a symmetric kernel; zero beyond the borders.
fn convolve(values: &[f32], grid: MapGrid, kernel: &[f32]) -> Vec<f32> {
    let (width, reach) = (grid.width, kernel.len() / 2);
    let mut across = vec![0.0_f32; values.len()];
    across.par_chunks_mut(width).zip(values.par_chunks(width)).for_each(|(to, from)| {
        let mut padded = vec![0.0; width + 2 * reach];
        padded[reach..reach + width].copy_from_slice(from);
        for (k, weight) in kernel.iter().enumerate() {
            to.iter_mut().zip(&padded[k..]).for_each(|(to, from)| *to += weight * from);
        }
    });
    let mut down = vec![0.0_f32; values.len()];
    down.par_chunks_mut(width).enumerate().for_each(|(y, to)| {
        for (k, weight) in kernel.iter().enumerate() {
            let row = (y + k).checked_sub(reach).filter(|row| *row < grid.height);
            let Some(row) = row else { continue };
            let from = &across[row * width..(row + 1) * width];
            to.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
        }
    });
    down
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_becomes_the_integral_of_aperture_and_gaussian_and_the_unknown_stays_unknown() {
        let grid = MapGrid { origin_mm: [0.0; 2], cell_mm: 0.1, width: 80, height: 60 };
        let value = |i: usize| match i % 80 {
            0..40 => 100.0,
            40..70 => 700.0,
            _ => f32::NAN,
        };
        let values = (0..grid.n_cells()).map(value).collect();
        let map = RadianceMap::new(grid, values, vec![2.0; grid.n_cells()]);
        // A pixel of 4 cells, and a Gaussian of 2 cells.
        let seen = blur_map(&map, PointSpread::of_sigma(0.5), 0.4);
        let at = |x: usize| seen.values()[30 * 80 + x];
        assert!((at(20) - 100.0).abs() < 1e-2 && (at(59) - 700.0).abs() < 0.5);
        assert!((at(39) + at(40) - 800.0).abs() < 1.0);
        // Variance of the step's spread: 4 from the Gaussian, 16 / 12 from the aperture.
        let slopes: Vec<f64> = (25..55).map(|x| f64::from(at(x + 1) - at(x))).collect();
        let sum: f64 = slopes.iter().sum();
        let mean = slopes.iter().enumerate().map(|(i, s)| i as f64 * s).sum::<f64>() / sum;
        let square =
            slopes.iter().enumerate().map(|(i, s)| (i as f64 - mean).powi(2) * s).sum::<f64>();
        assert!((square / sum - (4.0 + 16.0 / 12.0)).abs() < 0.15, "{}", square / sum);
        assert!(at(68).is_nan() && at(62).is_finite());
        let noise = seen.errors()[30 * 80 + 20];
        assert!(noise > 0.1 && noise < 0.5, "many cells are averaged: {noise}");
    }
}
