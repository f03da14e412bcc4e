//! Event-camera frames predicted from the map.

use super::blur::{PointSpread, blurred};
use super::davis::DavisTie;
use super::head::{MOUNT, stated_ray};
use super::map::{Mark, RadianceMap};
use super::survey::Survey;
use super::tag_fit::TIES;
use super::tone::Sample;
use super::warp::Warp;
use evrig_core::frame::Frame;
use evrig_core::geometry::Size;
use evrig_core::time::Davis;
use nalgebra::Vector3;

/// Shared unknowns: the alignment and the Gaussian's width.
pub(super) const SHARED: usize = TIES + 1;

/// Map features used per frame.
const MARKS: usize = 24_000;

/// Instants within an exposure.
const LOOKS: usize = 4;

/// Step of the derivative by the Gaussian's width, pixels.
const SIGMA_STEP: f64 = 0.02;

/// Pixel step in both axes for smooth samples.
const SMOOTH_STEP: usize = 3;

/// A point is smooth where the map changes by less than this share per pixel.
const SMOOTH: f64 = 0.04;

/// Least brightness of a smooth sample, as a share of white.
const LEAST_LIGHT: f64 = 0.03;

/// A frame and the instants in its exposure, seconds by the unrefined clock map.
pub(super) struct Picture {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
    pub(super) looks_s: [f64; LOOKS],
}

/// The blurred map at the present width of the Gaussian and one step beyond.
pub(super) struct Seen {
    pub(super) here: RadianceMap,
    pub(super) beyond: RadianceMap,
    pub(super) marks: Vec<Mark>,
}

/// One pixel's equation: value, expected light and derivatives.
pub(super) struct Row {
    pub(super) value: f64,
    pub(super) light: f64,
    pub(super) slopes: [f64; SHARED],
    pub(super) by_place: [f64; 2],
    /// Target position of its feature.
    pub(super) place_mm: [f64; 2],
}

impl Row {
    fn dimmed(mut self, passing: f64) -> Self {
        self.light *= passing;
        self.slopes.iter_mut().chain(&mut self.by_place).for_each(|slope| *slope *= passing);
        self
    }
}

impl Seen {
    pub(super) fn new(survey: &Survey, spread: PointSpread, pixel_mm: f64) -> Self {
        let wider = PointSpread { sigma_px: spread.sigma_px + SIGMA_STEP, ..spread };
        let here = blurred(&survey.map, spread, pixel_mm);
        let beyond = blurred(&survey.map, wider, pixel_mm);
        let marks = here.marks(MARKS, survey.white_dn);
        Self { here, beyond, marks }
    }
}

impl Picture {
    pub(super) fn new(survey: &Survey, tie: &DavisTie, frame: &Frame<Davis>) -> Self {
        let mapped = |stamp| tie.mapped_s(&survey.path, stamp);
        let middle = frame.timing.mid_exposure(0);
        let [start, end] = frame.timing.exposure.unwrap_or([middle; 2]).map(mapped);
        let look = |i: usize| start + (end - start) * (i as f64 + 0.5) / LOOKS as f64;
        Self {
            width: usize::from(frame.size.width),
            height: usize::from(frame.size.height),
            values: frame.brightness(),
            looks_s: std::array::from_fn(look),
        }
    }

    /// Equations of the pixels that view features.
    pub(super) fn rows(&self, survey: &Survey, tie: &DavisTie, seen: &Seen) -> Option<Vec<Row>> {
        let times = self.looks_s.map(|mapped_s| tie.path_s(mapped_s));
        let mut warps = Vec::with_capacity(LOOKS);
        for time_s in times {
            warps.push(tie.warp(&survey.head, &survey.path, time_s)?);
        }
        let middle_s = (times[0] + times[LOOKS - 1]) / 2.0;
        let since = middle_s - tie.lag_at_s;
        let pose = survey.path.pose(middle_s)?;
        let forward = tie.mount.davis_from_plane(&survey.head.pi_from_plane(&pose));
        let mut is_taken = vec![false; self.width * self.height];
        let mut rows = Vec::new();
        for mark in &seen.marks {
            let q = forward * Vector3::new(mark.place_mm[0], mark.place_mm[1], 1.0);
            let [px, py] = tie.mount.place([q.x / q.z, q.y / q.z]);
            if !(px >= 0.0 && py >= 0.0 && px < self.width as f64 && py < self.height as f64) {
                continue;
            }
            let (x, y) = (px as usize, py as usize);
            let at = y * self.width + x;
            if std::mem::replace(&mut is_taken[at], true) {
                continue;
            }
            if let Some(row) = row([x, y], f64::from(self.values[at]), tie, &warps, seen, since) {
                let passing = survey.passing(mark.place_mm, middle_s);
                rows.push(Row { place_mm: mark.place_mm, ..row.dimmed(passing) });
            }
        }
        Some(rows)
    }

    /// Samples of pixels that view smooth points, at mid-exposure.
    pub(super) fn smooth(
        &self,
        survey: &Survey,
        tie: &DavisTie,
        seen: &Seen,
        pixel_mm: f64,
    ) -> Option<Vec<Sample>> {
        let size = Size::new(self.width as u16, self.height as u16);
        let middle_s = tie.path_s(0.5 * (self.looks_s[0] + self.looks_s[LOOKS - 1]));
        let plane = tie.plane_from_ray(&survey.head, &survey.path, middle_s)?;
        let mut samples = Vec::new();
        for y in (0..self.height).step_by(SMOOTH_STEP) {
            for x in (0..self.width).step_by(SMOOTH_STEP) {
                let Some([u, v]) = tie.mount.ray([x as f64 + 0.5, y as f64 + 0.5]) else {
                    continue;
                };
                let place = plane * Vector3::new(u, v, 1.0);
                let place_mm = [place.x / place.z, place.y / place.z];
                let [light, dx, dy] = seen.here.sample(place_mm);
                let is_smooth = dx.hypot(dy) * pixel_mm < SMOOTH * light;
                let value = f64::from(self.values[y * self.width + x]);
                let mapped = light / survey.white_dn;
                // Excludes the ends of the eight-bit range.
                if is_smooth && mapped > LEAST_LIGHT && (1.0..254.0).contains(&value) {
                    let mapped = mapped * survey.passing(place_mm, middle_s);
                    samples.push(Sample::new(size, [x, y], value, mapped, place_mm));
                }
            }
        }
        Some(samples)
    }
}

fn row(
    [x, y]: [usize; 2],
    value: f64,
    tie: &DavisTie,
    warps: &[Warp<{ MOUNT + 1 }>],
    seen: &Seen,
    since_s: f64,
) -> Option<Row> {
    let stated = stated_ray(&tie.mount.lens, [x as f64 + 0.5, y as f64 + 0.5])?;
    let square = stated[0].powi(2) + stated[1].powi(2);
    let over_focal = (-tie.mount.ln_focal).exp();
    let longer = (1.0 + tie.mount.radial * square) * over_focal;
    let ray = stated.map(|part| part * longer);
    let (slopes, by_place) = ([0.0; SHARED], [0.0; 2]);
    let mut row = Row { value, light: 0.0, slopes, by_place, place_mm: [0.0; 2] };
    let share = 1.0 / warps.len() as f64;
    for warp in warps {
        let (place, moved) = warp.slopes(ray);
        let by_ray = warp.by_ray(ray);
        let [light, dx, dy] = seen.here.sample(place);
        let beyond = seen.beyond.sample(place)[0];
        let along = |[x, y]: [f64; 2]| share * (dx * x + dy * y);
        row.light += share * light;
        row.slopes.iter_mut().zip(&moved[..MOUNT]).for_each(|(slope, &by)| *slope += along(by));
        let by_ray = by_ray.map(along);
        // A longer focal length shortens rays, distortion lengthens them.
        row.slopes[6] -= by_ray[0] * ray[0] + by_ray[1] * ray[1];
        row.slopes[7] += (by_ray[0] * stated[0] + by_ray[1] * stated[1]) * square * over_focal;
        row.slopes[8] += along(moved[MOUNT]);
        row.slopes[TIES] += share * (beyond - light) / SIGMA_STEP;
        (0..2).for_each(|axis| {
            row.by_place[axis] += by_ray[axis] * over_focal / tie.mount.lens.focal_px
        });
    }
    row.slopes[9] = row.slopes[8] * since_s;
    (row.light + row.slopes.iter().sum::<f64>()).is_finite().then_some(row)
}
