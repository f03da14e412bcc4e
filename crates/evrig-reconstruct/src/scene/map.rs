//! Radiance map of the target as seen by the Pi camera.

use super::raster::Raster;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Grid of a map on the target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapGrid {
    /// Middle of the first cell, millimetres right and down from the target's origin.
    pub origin_mm: [f64; 2],
    /// Side of a cell, millimetres.
    pub cell_mm: f64,
    /// Columns of cells.
    pub width: usize,
    /// Rows of cells.
    pub height: usize,
}

/// Radiance of the target by cell, in the Pi's DN above black.
#[derive(Debug, Clone, PartialEq)]
pub struct RadianceMap {
    /// Grid of the cells.
    pub grid: MapGrid,
    /// Radiance; `NaN` where unobserved.
    pub(super) radiance: Raster,
    /// Standard errors, row-major; `NaN` where unknown.
    pub(super) errors: Vec<f32>,
}

/// A cell with a high image gradient, which constrains motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MapFeature {
    pub(super) place_mm: [f64; 2],
}

/// Side of a tile with an equal quota of features, cells.
const TILE: usize = 32;

impl MapGrid {
    /// From millimetres on the target to columns and rows; whole numbers at cell middles.
    pub(super) fn cell_from_plane(&self) -> Matrix3<f64> {
        let k = 1.0 / self.cell_mm;
        let [x, y] = self.origin_mm;
        Matrix3::new(k, 0.0, -k * x, 0.0, k, -k * y, 0.0, 0.0, 1.0)
    }

    #[inline]
    pub(super) fn cell(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        let [left, top] = self.origin_mm;
        [((x - left) / self.cell_mm) as f32, ((y - top) / self.cell_mm) as f32]
    }

    pub(super) fn place_mm(&self, column: usize, row: usize) -> [f64; 2] {
        let [left, top] = self.origin_mm;
        [left + column as f64 * self.cell_mm, top + row as f64 * self.cell_mm]
    }

    #[inline]
    pub(super) fn place_of(&self, [x, y]: [f32; 2]) -> [f64; 2] {
        let [left, top] = self.origin_mm;
        [left + f64::from(x) * self.cell_mm, top + f64::from(y) * self.cell_mm]
    }

    /// Number of cells.
    #[must_use]
    pub const fn n_cells(&self) -> usize {
        self.width * self.height
    }
}

impl RadianceMap {
    pub(super) fn new(grid: MapGrid, values: Vec<f32>, errors: Vec<f32>) -> Self {
        let radiance = Raster { width: grid.width, height: grid.height, values };
        Self { grid, radiance, errors }
    }

    /// Radiance of the cells, row-major, DN above black; `NaN` where unobserved.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.radiance.values
    }

    /// Standard errors of the cells' radiance, row-major.
    #[must_use]
    pub fn errors(&self) -> &[f32] {
        &self.errors
    }

    /// Radiance at a position and its gradient per millimetre.
    #[inline]
    pub(super) fn sample(&self, place_mm: [f64; 2]) -> [f64; 3] {
        let [x, y] = self.grid.cell(place_mm);
        let [value, dx, dy] = self.radiance.sample_with_slopes(x, y);
        let over = 1.0 / self.grid.cell_mm;
        [f64::from(value), f64::from(dx) * over, f64::from(dy) * over]
    }

    /// White level: a high quantile of the known cells.
    pub(super) fn white_dn(&self) -> Option<f64> {
        let mut known: Vec<f32> =
            self.values().iter().copied().filter(|value| value.is_finite()).collect();
        let last = known.len().checked_sub(1)?;
        let at = (last as f64 * 0.995) as usize;
        let (_, white, _) = known.select_nth_unstable_by(at, f32::total_cmp);
        (*white > 0.0).then(|| f64::from(*white))
    }

    /// Up to about `n` cells with the highest gradients, spread over the map.
    pub(super) fn features(&self, n: usize, white_dn: f64) -> Vec<MapFeature> {
        let MapGrid { width, height, .. } = self.grid;
        let noise_floor = 0.02 * white_dn as f32;
        let values = self.values();
        let score = |x: usize, y: usize| {
            let at = y * width + x;
            let dx = values[at + 1] - values[at - 1];
            let dy = values[at + width] - values[at - width];
            (dx * dx + dy * dy) / (values[at].max(0.0) + noise_floor)
        };
        let mut tiles: Vec<Vec<(f32, usize, usize)>> = Vec::new();
        for top in (2..height.saturating_sub(2)).step_by(TILE) {
            for left in (2..width.saturating_sub(2)).step_by(TILE) {
                let rows = top..(top + TILE).min(height - 2);
                let columns = left..(left + TILE).min(width - 2);
                let cells = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
                let scored = cells.map(|(x, y)| (score(x, y), x, y));
                tiles
                    .push(scored.filter(|(score, ..)| score.is_finite() && *score > 0.0).collect());
            }
        }
        // One threshold for the whole map, one quota for each tile.
        let mut all: Vec<f32> = tiles.iter().flatten().map(|(score, ..)| *score).collect();
        if all.is_empty() {
            return Vec::new();
        }
        let kept = all.len().saturating_sub(3 * n).min(all.len() - 1);
        let (_, least, _) = all.select_nth_unstable_by(kept, f32::total_cmp);
        let least = *least;
        tiles.iter_mut().for_each(|tile| tile.retain(|(score, ..)| *score >= least));
        let n_rough = tiles.iter().filter(|tile| !tile.is_empty()).count().max(1);
        let share = (n / n_rough).max(8);
        let feature =
            |(_, x, y): (f32, usize, usize)| MapFeature { place_mm: self.grid.place_mm(x, y) };
        let mut features = Vec::new();
        for mut tile in tiles {
            tile.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
            tile.truncate(share);
            // Row order keeps look-ups local in memory.
            tile.sort_by_key(|(_, x, y)| (*y, *x));
            features.extend(tile.into_iter().map(feature));
        }
        features
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White paper with one dark square.
    fn map() -> RadianceMap {
        let grid = MapGrid { origin_mm: [-10.0, -5.0], cell_mm: 0.2, width: 100, height: 60 };
        let dark = |i: usize| (40..60).contains(&(i % 100)) && (20..40).contains(&(i / 100));
        let values = (0..grid.n_cells()).map(|i| if dark(i) { 50.0 } else { 700.0 }).collect();
        RadianceMap::new(grid, values, vec![1.0; grid.n_cells()])
    }

    #[test]
    fn places_and_cells_are_the_same_grid() {
        let map = map();
        assert!((map.sample([0.0, 1.0])[0] - 50.0).abs() < 1e-3);
        assert!((map.sample([-4.0, 1.0])[0] - 700.0).abs() < 1e-3);
        // The left edge lies half a cell before the middle of column 40.
        let [value, slope, _] = map.sample([-10.0 + 39.5 * 0.2, 1.0]);
        assert!((value - 375.0).abs() < 1.0 && slope < -3_000.0, "{value} {slope}");
        assert_eq!(map.white_dn(), Some(700.0));
    }

    #[test]
    fn marks_are_on_edges_alone() {
        let features = map().features(100, 700.0);
        assert!(features.len() > 50, "{}", features.len());
        for MapFeature { place_mm: [x, y] } in features {
            let edge = |p: f64, from: f64, to: f64| (p - from).abs() < 0.5 || (p - to).abs() < 0.5;
            assert!(edge(x, -2.0, 2.0) || edge(y, -1.0, 3.0), "{x} {y}");
        }
        let blank = MapGrid { origin_mm: [0.0; 2], cell_mm: 1.0, width: 50, height: 50 };
        let blank = RadianceMap::new(blank, vec![f32::NAN; 2_500], vec![f32::NAN; 2_500]);
        assert!(blank.features(10, 1.0).is_empty() && blank.white_dn().is_none());
    }
}
