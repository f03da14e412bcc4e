//! Frame-to-map ratios on a coarse grid of the target.

use super::accumulate::{Keyframe, MapOptics};
use super::bilinear::BilinearWeights;
use super::map::{MapGrid, RadianceMap};
use super::map_samples::visit_map_samples;
use super::photometric::LEVEL_STEP;

/// Side of a cell, millimetres, and its fewest pixels.
const CELL_MM: f64 = 3.0;
const MIN_CELL_PIXELS: u32 = 5;

#[derive(Debug, Clone, Copy)]
pub(super) struct CoarseGrid {
    pub(super) origin_mm: [f64; 2],
    pub(super) width: usize,
    pub(super) height: usize,
}

impl CoarseGrid {
    pub(super) fn covering(grid: &MapGrid) -> Self {
        let side = |n: usize| (n as f64 * grid.cell_mm / CELL_MM).ceil().max(1.0) as usize;
        Self { origin_mm: grid.origin_mm, width: side(grid.width), height: side(grid.height) }
    }

    fn of(&self, place_mm: [f64; 2]) -> Option<usize> {
        let [x, y] = [0, 1].map(|axis| (place_mm[axis] - self.origin_mm[axis]) / CELL_MM);
        let is_inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        is_inside.then(|| y as usize * self.width + x as usize)
    }

    pub(super) fn middle_mm(&self, cell: usize) -> [f64; 2] {
        let at = [cell % self.width, cell / self.width];
        [0, 1].map(|axis| self.origin_mm[axis] + (at[axis] as f64 + 0.5) * CELL_MM)
    }

    /// Logarithm of a frame's light over the map's in every cell; `NaN` with too few pixels.
    pub(super) fn levels(&self, optics: &MapOptics, map: &RadianceMap, key: &Keyframe) -> Vec<f32> {
        let mut sums = vec![(0.0_f64, 0.0_f64, 0_u32); self.width * self.height];
        // A frame with a singular homography has no samples.
        let _ = visit_map_samples(optics, map, key, LEVEL_STEP, |sample| {
            if let Some(sum) = self.of(sample.place_mm).and_then(|cell| sums.get_mut(cell)) {
                *sum = (sum.0 + sample.light, sum.1 + sample.mapped[0], sum.2 + 1);
            }
        });
        let level = |&(measured, expected, n): &(f64, f64, u32)| {
            let is_known = n >= MIN_CELL_PIXELS && measured > 0.0 && expected > 0.0;
            if is_known { (measured / expected).ln() as f32 } else { f32::NAN }
        };
        sums.iter().map(level).collect()
    }

    /// Bilinear interpolation of one value per cell.
    pub(super) fn interpolate(&self, values: &[f64], place_mm: [f64; 2]) -> f64 {
        let at = |axis: usize| ((place_mm[axis] - self.origin_mm[axis]) / CELL_MM - 0.5) as f32;
        let corners = BilinearWeights::at([self.width, self.height], [at(0), at(1)]);
        corners.0.iter().map(|&(cell, weight)| values[cell] * f64::from(weight)).sum()
    }
}
