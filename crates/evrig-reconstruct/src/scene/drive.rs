//! Log-intensity signal from the map and the path.

use super::davis_alignment::DavisAlignment;
use super::head::HeadGeometry;
use super::map::{MapGrid, RadianceMap};
use super::moving_illumination::MovingIllumination;
use super::path::HeadPath;
use super::point_spread::{PointSpread, blur_map, log_map};
use super::raster::Raster;
use super::reconstruction::Reconstruction;
use super::registration::Registration;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::geometry::Size;
use evrig_core::time::{Davis, Stamp};
use nalgebra::Matrix3;
use std::sync::{Arc, PoisonError, RwLock};

/// Darkest radiance that is resolved, as a share of white.
const MIN_WHITE_SHARE: f64 = 1e-3;
/// Instants along the path at which the error is evaluated.
const ERROR_INSTANTS: usize = 24;

/// Log-intensity signal of event pixels that view the mapped target.
///
/// Variants with other optics, clock or position share the map, the path and the geometry.
#[derive(Debug)]
pub struct SceneDrive {
    size: Size,
    span_us: [i64; 2],
    white_dn: f64,
    map: Arc<RadianceMap>,
    path: Arc<HeadPath>,
    head: HeadGeometry,
    alignment: DavisAlignment,
    pixel_mm: f64,
    spread: PointSpread,
    offset_us: f64,
    shift_px: [f64; 2],
    blurred: Arc<BlurredMap>,
    illumination: Option<Arc<MovingIllumination>>,
    /// Standard error of position from path and registration, DAVIS pixels.
    place_error_px: f64,
    /// Relative error of the map's radiance, as a share of it.
    light_error: f64,
    poses: RwLock<Option<Arc<PoseTable>>>,
}

#[derive(Debug)]
struct BlurredMap {
    grid: MapGrid,
    log: Raster,
    errors: Vec<f32>,
}

#[derive(Debug)]
struct PoseTable {
    grid: TimeGrid,
    /// Homography from rays to map columns and rows with its last element one; None off the path.
    cell_from_ray: Vec<Option<[f64; 8]>>,
    ln_light: Vec<f32>,
    times_s: Vec<f64>,
}

impl SceneDrive {
    /// The drive of an event camera of `size` aligned to a reconstruction.
    #[must_use]
    pub fn new(size: Size, reconstruction: &Reconstruction, registration: &Registration) -> Self {
        let alignment = registration.alignment;
        let path = &reconstruction.path;
        let span_us = path.span_s().map_or([0, 0], |[from, to]| {
            [alignment.stamp(path, from).as_micros() + 1, alignment.stamp(path, to).as_micros() - 1]
        });
        let map = Arc::new(reconstruction.map.clone());
        let spread = registration.spread;
        let blurred =
            Arc::new(BlurredMap::new(&map, reconstruction.white_dn, spread, registration.pixel_mm));
        Self {
            size,
            span_us,
            white_dn: reconstruction.white_dn,
            map,
            path: Arc::new(path.clone()),
            head: reconstruction.head,
            alignment,
            pixel_mm: registration.pixel_mm,
            spread,
            offset_us: 0.0,
            shift_px: [0.0; 2],
            blurred,
            illumination: reconstruction.moving_illumination.clone().map(Arc::new),
            place_error_px: registration
                .residual_px
                .hypot(path.place_error_mm() / registration.pixel_mm),
            light_error: registration.light_error,
            poses: RwLock::new(None),
        }
    }

    fn variant(&self) -> Self {
        Self {
            map: Arc::clone(&self.map),
            path: Arc::clone(&self.path),
            blurred: Arc::clone(&self.blurred),
            illumination: self.illumination.clone(),
            poses: RwLock::new(None),
            ..*self
        }
    }

    /// The same scene with another point-spread function.
    #[must_use]
    pub fn with_spread(&self, spread: PointSpread) -> Self {
        let blurred = Arc::new(BlurredMap::new(&self.map, self.white_dn, spread, self.pixel_mm));
        Self { spread, blurred, ..self.variant() }
    }

    /// The same scene with DAVIS stamps late by so many more microseconds (positive: a stamp is
    /// later than the light it shows).
    #[must_use]
    pub fn with_offset_us(&self, offset_us: f64) -> Self {
        Self { offset_us, ..self.variant() }
    }

    /// The same scene shifted on the sensor by so many columns and rows.
    #[must_use]
    pub fn with_shift_px(&self, shift_px: [f64; 2]) -> Self {
        Self { shift_px, ..self.variant() }
    }

    /// Point-spread function from the map to the event pixels.
    #[must_use]
    pub fn spread(&self) -> PointSpread {
        self.spread
    }

    /// Grid of the map.
    #[must_use]
    pub fn grid(&self) -> MapGrid {
        self.map.grid
    }

    /// Target position in millimetres seen at a sensor position in pixels; None off the path.
    #[must_use]
    pub fn place_mm(&self, place: [f64; 2], t_us: f64) -> Option<[f64; 2]> {
        let [u, v] = self.ray(place)?;
        let plane = self.plane_from_ray(t_us)?;
        let q = plane * nalgebra::Vector3::new(u, v, 1.0);
        Some([q.x / q.z, q.y / q.z])
    }

    fn ray(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        self.alignment.mount.ray([u - self.shift_px[0], v - self.shift_px[1]])
    }

    fn path_s(&self, t_us: f64) -> f64 {
        let true_us = t_us - self.offset_us;
        // Clock maps take whole microseconds; the fraction is added afterwards.
        let whole = true_us.floor();
        let mapped = self.alignment.mapped_s(&self.path, Stamp::<Davis>::from_micros(whole as i64));
        self.alignment.path_s(mapped + (true_us - whole) * 1e-6)
    }

    fn plane_from_ray(&self, t_us: f64) -> Option<Matrix3<f64>> {
        self.alignment.plane_from_ray(&self.head, &self.path, self.path_s(t_us))
    }

    /// Geometry at the instants of a grid; the last one is cached.
    fn poses(&self, grid: TimeGrid) -> Arc<PoseTable> {
        let kept = self.poses.read().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(poses) = kept.filter(|poses| poses.grid == grid) {
            return poses;
        }
        let cells = self.blurred.grid.cell_from_plane();
        let mut ln_light = Vec::with_capacity(grid.n);
        let mut cell_from_ray = Vec::with_capacity(grid.n);
        let mut times_s = Vec::with_capacity(grid.n);
        for i in 0..grid.n {
            let t_us = grid.at(i) as f64;
            times_s.push(self.path_s(t_us));
            ln_light.push(self.path.ln_light(times_s[i]) as f32);
            cell_from_ray.push(self.plane_from_ray(t_us).map(|plane| {
                let m = cells * plane;
                std::array::from_fn(|k| m[(k / 3, k % 3)] / m[(2, 2)])
            }));
        }
        let poses = Arc::new(PoseTable { grid, cell_from_ray, ln_light, times_s });
        *self.poses.write().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&poses));
        poses
    }
}

impl BlurredMap {
    fn new(map: &RadianceMap, white_dn: f64, spread: PointSpread, pixel_mm: f64) -> Self {
        let blurred = blur_map(map, spread, pixel_mm);
        let least_dn = MIN_WHITE_SHARE * white_dn;
        let error = |(error, value): (&f32, &f32)| error / value.max(least_dn as f32);
        let errors = blurred.errors().iter().zip(blurred.values()).map(error).collect();
        Self { grid: map.grid, log: log_map(&blurred, white_dn, least_dn), errors }
    }
}

#[inline]
fn cell(m: &[f64; 8], [u, v]: [f64; 2]) -> [f32; 2] {
    let over = 1.0 / (m[6] * u + m[7] * v + 1.0);
    let x = (m[0] * u + m[1] * v + m[2]) * over;
    let y = (m[3] * u + m[4] * v + m[5]) * over;
    [x as f32, y as f32]
}

impl Drive for SceneDrive {
    fn size(&self) -> Size {
        self.size
    }

    fn span_us(&self) -> [i64; 2] {
        self.span_us
    }

    fn white_dn(&self) -> f64 {
        self.white_dn
    }

    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        out.fill(f32::NAN);
        let Some(ray) = self.ray(place) else { return false };
        let poses = self.poses(grid);
        let mut any = false;
        let instants = poses.cell_from_ray.iter().zip(&poses.ln_light).zip(&poses.times_s);
        for (out, ((matrix, ln_light), time_s)) in out.iter_mut().zip(instants) {
            let Some(matrix) = matrix else { continue };
            let [x, y] = cell(matrix, ray);
            let ln_illumination = self.illumination.as_ref().map_or(0.0, |illumination| {
                let grid = &self.blurred.grid;
                illumination.ln_at(grid.place_of([x, y]), *time_s) as f32
            });
            *out = self.blurred.log.sample(x, y) + ln_light + ln_illumination;
            any |= !out.is_nan();
        }
        any
    }

    fn jumps_us(&self) -> Vec<[i64; 2]> {
        let [from, to] = self.span_us;
        let stamp = |s: f64| self.alignment.stamp(&self.path, s).as_micros();
        let late = self.offset_us.round() as i64;
        let jumps = self.path.jumps_s().into_iter();
        jumps.map(|ends| ends.map(|s| (stamp(s) + late).clamp(from, to))).collect()
    }

    fn error(&self, place: [f64; 2]) -> f32 {
        let Some(ray) = self.ray(place) else { return f32::NAN };
        let [from, to] = self.span_us;
        let step_us = ((to - from) / ERROR_INSTANTS as i64).clamp(1, i64::from(u32::MAX)) as u32;
        let (mut sum, mut n) = (0.0_f64, 0);
        for i in 0..ERROR_INSTANTS {
            let t_us = (from + i as i64 * i64::from(step_us)) as f64;
            let Some(plane) = self.plane_from_ray(t_us) else { continue };
            let m = self.blurred.grid.cell_from_plane() * plane;
            let [x, y] = cell(&std::array::from_fn(|k| m[(k / 3, k % 3)] / m[(2, 2)]), ray);
            let [value, dx, dy] = self.blurred.log.sample_with_slopes(x, y);
            if !value.is_finite() {
                continue;
            }
            let at = (y as usize) * self.blurred.grid.width + x as usize;
            let cells_per_px = self.pixel_mm / self.blurred.grid.cell_mm;
            let slope = f64::from(dx.hypot(dy)) * cells_per_px * self.place_error_px;
            // A difference of two samples has the variance of both.
            let noise = f64::from(self.blurred.errors[at]);
            sum += 2.0 * (noise.powi(2) + self.light_error.powi(2) + slope.powi(2));
            n += 1;
        }
        if n == 0 { f32::NAN } else { (sum / f64::from(n)).sqrt() as f32 }
    }
}
