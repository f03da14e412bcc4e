//! Accumulation of frames on the map.

use super::bilinear::BilinearWeights;
use super::error::SceneError;
use super::head::{HeadGeometry, HeadPose, POSE_DOF};
use super::map::{MapGrid, RadianceMap};
use super::pi_camera::PiCamera;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::Arc;

/// A frame held in memory while the map is estimated.
#[derive(Debug, Clone)]
pub(super) struct Keyframe {
    pub(super) samples: Arc<Vec<u16>>,
    /// Mid-exposure of the first row, seconds from the path's zero.
    pub(super) first_s: f64,
    pub(super) exposure_s: f64,
    /// At the middle row.
    pub(super) pose: HeadPose,
    /// Derivative of the pose per second.
    pub(super) speed: HeadPose,
    pub(super) ln_gain: f64,
}

/// The camera, the head's geometry, and the row time.
#[derive(Debug, Clone)]
pub(super) struct MapOptics {
    pub(super) camera: PiCamera,
    pub(super) head: HeadGeometry,
    pub(super) row_s: f64,
}

/// Side of a cell in Pi pixels.
const CELL_PX: f64 = 0.8;
const MAX_CELLS: usize = 6_000_000;
/// Partial sums, added in order: the result does not depend on the number of threads.
const PARTIAL_SUMS: usize = 4;
/// Least weight of a known cell, in pixels.
const MIN_WEIGHT_PX: f32 = 1.5;
/// Column pairs between samples for the Bayer gains.
const SITE_STEP_COLUMNS: usize = 23;

/// Sums of a cell: weights, weighted light, squared weights, weighted squared residuals against the
/// previous map.
type MapSums = Vec<[f32; 4]>;

type Pixel = (usize, usize, f32);

impl MapOptics {
    pub(super) fn pose_of_row(&self, key: &Keyframe, row: f64) -> HeadPose {
        let late_s = (row - self.camera.middle_row()) * self.row_s;
        std::array::from_fn::<f64, POSE_DOF, _>(|i| key.pose[i] + key.speed[i] * late_s)
    }

    /// Mid-exposure of the middle row.
    pub(super) fn middle_s(&self, first_s: f64) -> f64 {
        first_s + self.camera.middle_row() * self.row_s
    }

    /// Image motion within a row's exposure, Pi pixels.
    fn blur_px(&self, key: &Keyframe) -> f64 {
        let along = key.speed[0].hypot(key.speed[1]) * key.exposure_s;
        along * self.camera.lens.focal_px / key.pose[2].abs().max(1.0)
    }
}

pub(super) fn grid_covering(optics: &MapOptics, keys: &[Keyframe]) -> Result<MapGrid, SceneError> {
    let camera = &optics.camera;
    let (right, bottom) = (usize::from(camera.size.width) - 1, usize::from(camera.size.height) - 1);
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    let mut pixel_mm = 0.0;
    for key in keys {
        let Some(plane) = optics.head.plane_from_pi(&key.pose) else { continue };
        for (x, y) in [(0, 0), (right, 0), (0, bottom), (right, bottom)] {
            let [u, v] = camera.ray(x, y);
            let place = plane * Vector3::new(u, v, 1.0);
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis] / place.z);
                high[axis] = high[axis].max(place[axis] / place.z);
            }
        }
        pixel_mm += key.pose[2] / camera.lens.focal_px / keys.len() as f64;
    }
    let cell_mm = CELL_PX * pixel_mm;
    let side = |axis: usize| ((high[axis] - low[axis]) / cell_mm).ceil() + 5.0;
    let cells = side(0) * side(1);
    if !(cells > 0.0 && cells <= MAX_CELLS as f64) {
        return Err(SceneError::TooLarge { cells, limit: MAX_CELLS });
    }
    let origin_mm = low.map(|low| low - 2.0 * cell_mm);
    Ok(MapGrid { origin_mm, cell_mm, width: side(0) as usize, height: side(1) as usize })
}

/// Weighted mean of the frames on the grid; errors are estimated where `before` is given.
pub(super) fn accumulate(
    grid: MapGrid,
    optics: &MapOptics,
    keys: &[Keyframe],
    before: Option<&RadianceMap>,
) -> RadianceMap {
    let share = keys.len().div_ceil(PARTIAL_SUMS).max(1);
    let partial_sums: Vec<MapSums> = keys
        .par_chunks(share)
        .map(|keys| {
            let mut sums = vec![[0.0; 4]; grid.n_cells()];
            keys.iter().for_each(|key| add_frame(&mut sums, grid, optics, key, before));
            sums
        })
        .collect();
    let mut values = vec![f32::NAN; grid.n_cells()];
    let mut errors = vec![f32::NAN; grid.n_cells()];
    values.par_iter_mut().zip(&mut errors).enumerate().for_each(|(i, (value, error))| {
        let mut sum = [0.0_f32; 4];
        for sums in &partial_sums {
            (0..4).for_each(|part| sum[part] += sums[i][part]);
        }
        let [weight, light, squares, residual] = sum;
        if weight >= MIN_WEIGHT_PX {
            *value = light / weight;
            let n = weight * weight / squares;
            *error = if before.is_some() { (residual / weight / n).sqrt() } else { f32::NAN };
        }
    });
    RadianceMap::new(grid, values, errors)
}

fn add_frame(
    sums: &mut MapSums,
    grid: MapGrid,
    optics: &MapOptics,
    key: &Keyframe,
    before: Option<&RadianceMap>,
) {
    let (width, height) =
        (usize::from(optics.camera.size.width), usize::from(optics.camera.size.height));
    // Motion-blurred frames weigh less.
    let blur_weight = (1.0 / (1.0 + optics.blur_px(key).powi(2))) as f32;
    let over_level = (-key.ln_gain).exp() as f32;
    for y in 0..height {
        let pose = optics.pose_of_row(key, y as f64);
        let Some(plane) = optics.head.plane_from_pi(&pose) else { continue };
        let m = (grid.cell_from_plane() * plane).map(|part| part as f32);
        for x in 0..width {
            let Some(light) = optics.camera.light(&key.samples, x, y) else { continue };
            let [u, v] = optics.camera.ray(x, y).map(|part| part as f32);
            let over = 1.0 / (m[(2, 0)] * u + m[(2, 1)] * v + m[(2, 2)]);
            let column = (m[(0, 0)] * u + m[(0, 1)] * v + m[(0, 2)]) * over;
            let row = (m[(1, 0)] * u + m[(1, 1)] * v + m[(1, 2)]) * over;
            let weight = blur_weight * optics.camera.weight(x, y);
            add(sums, grid, [column, row], light * over_level, weight, before);
        }
    }
}

/// Adds a pixel's light to its four neighbouring cells.
#[inline]
fn add(
    sums: &mut MapSums,
    grid: MapGrid,
    [column, row]: [f32; 2],
    light: f32,
    weight: f32,
    before: Option<&RadianceMap>,
) {
    let is_inside = column >= 0.0
        && row >= 0.0
        && column < (grid.width - 1) as f32
        && row < (grid.height - 1) as f32;
    if !is_inside {
        return;
    }
    let corners = BilinearWeights::at([grid.width, grid.height], [column, row]);
    let residual = before.map_or(0.0, |map| {
        let residual = light - corners.value(map.values());
        if residual.is_finite() { residual * residual } else { 0.0 }
    });
    for (cell, share) in corners.0 {
        let w = weight * share;
        let sums = &mut sums[cell];
        sums[0] += w;
        sums[1] += w * light;
        sums[2] += w * w;
        sums[3] += w * residual;
    }
}

/// Ratios of the four Bayer sites' readings to the map.
pub(super) fn site_ratios(optics: &MapOptics, keys: &[Keyframe], map: &RadianceMap) -> [f64; 4] {
    let camera = &optics.camera;
    let (width, height) = (usize::from(camera.size.width), usize::from(camera.size.height));
    let of_key = |key: &Keyframe| {
        let mut sums = [[0.0_f64; 2]; 4];
        for y in 0..height {
            let Some(plane) = optics.head.plane_from_pi(&optics.pose_of_row(key, y as f64)) else {
                continue;
            };
            for cell in (0..width / 2).step_by(SITE_STEP_COLUMNS) {
                for x in [2 * cell, 2 * cell + 1] {
                    let (x, y, light): Pixel = match camera.light(&key.samples, x, y) {
                        Some(light) => (x, y, light),
                        None => continue,
                    };
                    let [u, v] = camera.ray(x, y);
                    let place = plane * Vector3::new(u, v, 1.0);
                    let expected = map.sample([place.x / place.z, place.y / place.z])[0];
                    if expected.is_finite() {
                        let expected = expected * key.ln_gain.exp();
                        let site = y % 2 * 2 + x % 2;
                        sums[site][0] += f64::from(light) * expected;
                        sums[site][1] += expected * expected;
                    }
                }
            }
        }
        sums
    };
    let all: Vec<_> = keys.par_iter().map(of_key).collect();
    std::array::from_fn(|site| {
        let sum = |part: usize| all.iter().map(|sums| sums[site][part]).sum::<f64>();
        sum(0) / sum(1)
    })
}
