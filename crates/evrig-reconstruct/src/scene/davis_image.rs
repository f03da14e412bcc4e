//! Event-camera frames predicted from the map.

use super::davis_alignment::DavisAlignment;
use super::head::{MOUNT_DOF, stated_ray};
use super::map::{MapFeature, RadianceMap};
use super::point_spread::{PointSpread, blur_map};
use super::reconstruction::Reconstruction;
use super::tag_alignment::ALIGNMENT_DOF;
use super::tone::ToneSample;
use super::warp::Warp;
use evrig_core::frame::Frame;
use evrig_core::geometry::Size;
use evrig_core::time::Davis;
use nalgebra::Vector3;

/// Shared unknowns: the alignment and the Gaussian's width.
pub(super) const REGISTRATION_UNKNOWNS: usize = ALIGNMENT_DOF + 1;
/// Map features used per frame.
const MAX_FEATURES: usize = 24_000;
/// Instants within an exposure.
const EXPOSURE_INSTANTS: usize = 4;
/// Step of the derivative by the Gaussian's width, pixels.
const SIGMA_STEP: f64 = 0.02;
/// Pixel step in both axes for smooth samples.
const SMOOTH_STEP_PX: usize = 3;
/// A point is smooth where the map changes by less than this share per pixel.
const MAX_SMOOTH_GRADIENT: f64 = 0.04;
/// Least brightness of a smooth sample, as a share of white.
const MIN_WHITE_SHARE: f64 = 0.03;

/// A frame and the instants in its exposure, seconds by the unrefined clock map.
pub(super) struct DavisImage {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
    pub(super) instants_s: [f64; EXPOSURE_INSTANTS],
}

/// The blurred map at the present width of the Gaussian and one step beyond.
pub(super) struct PredictedMap {
    pub(super) here: RadianceMap,
    pub(super) beyond: RadianceMap,
    pub(super) features: Vec<MapFeature>,
}

pub(super) struct PixelEquation {
    pub(super) value: f64,
    pub(super) light: f64,
    pub(super) slopes: [f64; REGISTRATION_UNKNOWNS],
    pub(super) by_place: [f64; 2],
    pub(super) place_mm: [f64; 2],
}

impl PixelEquation {
    fn attenuated(mut self, illumination: f64) -> Self {
        self.light *= illumination;
        self.slopes.iter_mut().chain(&mut self.by_place).for_each(|slope| *slope *= illumination);
        self
    }
}

impl PredictedMap {
    pub(super) fn new(target: &Reconstruction, spread: PointSpread, pixel_mm: f64) -> Self {
        let wider = PointSpread { sigma_px: spread.sigma_px + SIGMA_STEP, ..spread };
        let here = blur_map(&target.map, spread, pixel_mm);
        let beyond = blur_map(&target.map, wider, pixel_mm);
        let features = here.features(MAX_FEATURES, target.white_dn);
        Self { here, beyond, features }
    }
}

impl DavisImage {
    pub(super) fn new(
        target: &Reconstruction,
        alignment: &DavisAlignment,
        frame: &Frame<Davis>,
    ) -> Self {
        let mapped = |stamp| alignment.mapped_s(&target.path, stamp);
        let middle = frame.timing.mid_exposure(0);
        let [start, end] = frame.timing.exposure.unwrap_or([middle; 2]).map(mapped);
        let instant =
            |i: usize| start + (end - start) * (i as f64 + 0.5) / EXPOSURE_INSTANTS as f64;
        Self {
            width: usize::from(frame.size.width),
            height: usize::from(frame.size.height),
            values: frame.brightness(),
            instants_s: std::array::from_fn(instant),
        }
    }

    pub(super) fn equations(
        &self,
        target: &Reconstruction,
        alignment: &DavisAlignment,
        predicted: &PredictedMap,
    ) -> Option<Vec<PixelEquation>> {
        let times = self.instants_s.map(|mapped_s| alignment.path_s(mapped_s));
        let mut warps = Vec::with_capacity(EXPOSURE_INSTANTS);
        for time_s in times {
            warps.push(alignment.warp(&target.head, &target.path, time_s)?);
        }
        let middle_s = (times[0] + times[EXPOSURE_INSTANTS - 1]) / 2.0;
        let since = middle_s - alignment.lag_at_s;
        let pose = target.path.pose(middle_s)?;
        let forward = alignment.mount.davis_from_plane(&target.head.pi_from_plane(&pose));
        let mut is_taken = vec![false; self.width * self.height];
        let mut equations = Vec::new();
        for feature in &predicted.features {
            let q = forward * Vector3::new(feature.place_mm[0], feature.place_mm[1], 1.0);
            let [px, py] = alignment.mount.place([q.x / q.z, q.y / q.z]);
            if !(px >= 0.0 && py >= 0.0 && px < self.width as f64 && py < self.height as f64) {
                continue;
            }
            let (x, y) = (px as usize, py as usize);
            let at = y * self.width + x;
            if std::mem::replace(&mut is_taken[at], true) {
                continue;
            }
            if let Some(equation) =
                equation([x, y], f64::from(self.values[at]), alignment, &warps, predicted, since)
            {
                let illumination = target.illumination(feature.place_mm, middle_s);
                equations.push(PixelEquation {
                    place_mm: feature.place_mm,
                    ..equation.attenuated(illumination)
                });
            }
        }
        Some(equations)
    }

    /// Samples of pixels that view smooth points, at mid-exposure.
    pub(super) fn smooth_samples(
        &self,
        target: &Reconstruction,
        alignment: &DavisAlignment,
        predicted: &PredictedMap,
        pixel_mm: f64,
    ) -> Option<Vec<ToneSample>> {
        let size = Size::new(self.width as u16, self.height as u16);
        let middle_s =
            alignment.path_s(0.5 * (self.instants_s[0] + self.instants_s[EXPOSURE_INSTANTS - 1]));
        let plane = alignment.plane_from_ray(&target.head, &target.path, middle_s)?;
        let mut samples = Vec::new();
        for y in (0..self.height).step_by(SMOOTH_STEP_PX) {
            for x in (0..self.width).step_by(SMOOTH_STEP_PX) {
                let Some([u, v]) = alignment.mount.ray([x as f64 + 0.5, y as f64 + 0.5]) else {
                    continue;
                };
                let place = plane * Vector3::new(u, v, 1.0);
                let place_mm = [place.x / place.z, place.y / place.z];
                let [light, dx, dy] = predicted.here.sample(place_mm);
                let is_smooth = dx.hypot(dy) * pixel_mm < MAX_SMOOTH_GRADIENT * light;
                let value = f64::from(self.values[y * self.width + x]);
                let mapped = light / target.white_dn;
                // Excludes the ends of the eight-bit range.
                if is_smooth && mapped > MIN_WHITE_SHARE && (1.0..254.0).contains(&value) {
                    let mapped = mapped * target.illumination(place_mm, middle_s);
                    samples.push(ToneSample::new(size, [x, y], value, mapped, place_mm));
                }
            }
        }
        Some(samples)
    }
}

fn equation(
    [x, y]: [usize; 2],
    value: f64,
    alignment: &DavisAlignment,
    warps: &[Warp<{ MOUNT_DOF + 1 }>],
    predicted: &PredictedMap,
    since_s: f64,
) -> Option<PixelEquation> {
    let stated = stated_ray(&alignment.mount.lens, [x as f64 + 0.5, y as f64 + 0.5])?;
    let square = stated[0].powi(2) + stated[1].powi(2);
    let over_focal = (-alignment.mount.ln_focal).exp();
    let longer = (1.0 + alignment.mount.radial * square) * over_focal;
    let ray = stated.map(|part| part * longer);
    let (slopes, by_place) = ([0.0; REGISTRATION_UNKNOWNS], [0.0; 2]);
    let mut equation = PixelEquation { value, light: 0.0, slopes, by_place, place_mm: [0.0; 2] };
    let share = 1.0 / warps.len() as f64;
    for warp in warps {
        let (place, moved) = warp.slopes(ray);
        let by_ray = warp.by_ray(ray);
        let [light, dx, dy] = predicted.here.sample(place);
        let beyond = predicted.beyond.sample(place)[0];
        let along = |[x, y]: [f64; 2]| share * (dx * x + dy * y);
        equation.light += share * light;
        equation
            .slopes
            .iter_mut()
            .zip(&moved[..MOUNT_DOF])
            .for_each(|(slope, &by)| *slope += along(by));
        let by_ray = by_ray.map(along);
        // A longer focal length shortens rays, distortion lengthens them.
        equation.slopes[6] -= by_ray[0] * ray[0] + by_ray[1] * ray[1];
        equation.slopes[7] += (by_ray[0] * stated[0] + by_ray[1] * stated[1]) * square * over_focal;
        equation.slopes[8] += along(moved[MOUNT_DOF]);
        equation.slopes[ALIGNMENT_DOF] += share * (beyond - light) / SIGMA_STEP;
        (0..2).for_each(|axis| {
            equation.by_place[axis] += by_ray[axis] * over_focal / alignment.mount.lens.focal_px
        });
    }
    equation.slopes[9] = equation.slopes[8] * since_s;
    (equation.light + equation.slopes.iter().sum::<f64>()).is_finite().then_some(equation)
}
