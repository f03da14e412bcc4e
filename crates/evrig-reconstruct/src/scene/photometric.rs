//! Photometric alignment of one frame to the map: normal equations for its pose, its brightness and
//! the shared constants.

use super::accumulate::{Keyframe, MapOptics};
use super::head::{HEAD_DOF, HeadGeometry, POSE_DOF, stated_place};
use super::map::{MapFeature, RadianceMap};
use super::map_samples::visit_map_samples;
use super::warp::Warp;
use nalgebra::{SMatrix, SVector, Vector3};

pub(super) const FRAME_UNKNOWNS: usize = POSE_DOF + 1;
/// Unknowns shared by all frames: the head's constants and the row time.
pub(super) const SHARED_UNKNOWNS: usize = HEAD_DOF + 1;
/// All unknowns, the frame's own first.
pub(super) const ALL_UNKNOWNS: usize = FRAME_UNKNOWNS + SHARED_UNKNOWNS;

#[derive(Debug, Clone)]
pub(super) struct FrameEquations<const N: usize> {
    pub(super) normal: SMatrix<f64, N, N>,
    pub(super) right: SVector<f64, N>,
    /// Weighted sum of squared residuals, in units of the assumed noise variance.
    pub(super) weighted_squares: f64,
    pub(super) n: usize,
    /// Features whose residual is within the Huber threshold.
    pub(super) n_agreeing: usize,
    /// Right side by parts of the map whose errors are independent.
    pub(super) by_part: Vec<SVector<f64, N>>,
}

/// Steps of the numerical derivatives.
const POSE_STEPS: [f64; POSE_DOF] = [1e-3, 1e-3, 1e-2, 1e-6];
const HEAD_STEPS: [f64; HEAD_DOF] = [1e-5; HEAD_DOF];
/// Huber threshold in standard deviations.
const HUBER_SIGMAS: f64 = 2.5;
/// Parts of the map for the clustered covariance, each of neighbouring features.
const MAP_PARTS: usize = 32;
/// Rows at which the geometry is evaluated exactly; linear in between.
const ANCHOR_ROWS: usize = 9;
/// Pixel step in both axes for a frame's brightness level; odd, so that all Bayer sites contribute.
pub(super) const LEVEL_STEP: usize = 7;
/// Fewest pixels for a brightness level.
const MIN_LEVEL_PIXELS: usize = 200;

/// Shot noise: the variance is proportional to the signal above a floor, both in DN.
#[derive(Debug, Clone, Copy)]
pub(super) struct PhotometricNoise {
    pub(super) variance_per_dn: f64,
    pub(super) floor_dn: f64,
}

impl PhotometricNoise {
    fn variance(&self, light_dn: f64) -> f64 {
        self.variance_per_dn * (light_dn.max(0.0) + self.floor_dn)
    }
}

pub(super) struct MapReference<'a> {
    pub(super) optics: &'a MapOptics,
    pub(super) map: &'a RadianceMap,
    pub(super) features: &'a [MapFeature],
    pub(super) noise: PhotometricNoise,
}

impl MapReference<'_> {
    /// Logarithm of a frame's brightness over that of the map, from sums over the whole frame.
    ///
    /// The gain in the pose equations is biased: edges dominate it, their dark side most, and
    /// motion blur brightens that side. A sum over the frame does not depend on blur.
    pub(super) fn ln_level(&self, key: &Keyframe) -> Option<f64> {
        let (mut measured, mut expected, mut n) = (0.0_f64, 0.0_f64, 0_usize);
        visit_map_samples(self.optics, self.map, key, LEVEL_STEP, |sample| {
            (measured, expected, n) = (measured + sample.light, expected + sample.mapped[0], n + 1);
        })?;
        let is_known = n >= MIN_LEVEL_PIXELS && measured > 0.0 && expected > 0.0;
        is_known.then(|| (measured / expected).ln())
    }

    pub(super) fn frame_equations(&self, key: &Keyframe) -> Option<FrameEquations<FRAME_UNKNOWNS>> {
        self.equations::<POSE_DOF, FRAME_UNKNOWNS>(key, &POSE_STEPS)
    }

    /// Equations for all unknowns, in the order pose, brightness, head, row time.
    pub(super) fn joint_equations(&self, key: &Keyframe) -> Option<FrameEquations<ALL_UNKNOWNS>> {
        let mut steps = [0.0; POSE_DOF + HEAD_DOF];
        steps[..POSE_DOF].copy_from_slice(&POSE_STEPS);
        steps[POSE_DOF..].copy_from_slice(&HEAD_STEPS);
        let mixed = self.equations::<{ POSE_DOF + HEAD_DOF }, ALL_UNKNOWNS>(key, &steps)?;
        let order: [usize; ALL_UNKNOWNS] = std::array::from_fn(|i| match i {
            i if i < POSE_DOF => i,
            POSE_DOF => POSE_DOF + HEAD_DOF,
            i if i < ALL_UNKNOWNS - 1 => i - 1,
            i => i,
        });
        Some(FrameEquations {
            normal: SMatrix::from_fn(|i, j| mixed.normal[(order[i], order[j])]),
            right: SVector::from_fn(|i, _| mixed.right[order[i]]),
            weighted_squares: mixed.weighted_squares,
            n: mixed.n,
            n_agreeing: mixed.n_agreeing,
            by_part: Vec::new(),
        })
    }

    /// `W` parameters of geometry, then brightness, then (where `N > W + 1`) the row time.
    fn equations<const W: usize, const N: usize>(
        &self,
        key: &Keyframe,
        steps: &[f64; W],
    ) -> Option<FrameEquations<N>> {
        let MapOptics { camera, head, .. } = self.optics;
        let (width, height) = (f64::from(camera.size.width), f64::from(camera.size.height));
        let warps = self.warps_of_rows(key, steps)?;
        let forward = head.pi_from_plane(&key.pose);
        let level = key.ln_gain.exp();
        let mut normal = [[0.0; N]; N];
        let mut right = [0.0; N];
        let (mut weighted_squares, mut n, mut n_agreeing) = (0.0, 0_usize, 0_usize);
        let mut by_part = vec![SVector::<f64, N>::zeros(); MAP_PARTS];
        for (feature, number) in self.features.iter().zip(0..) {
            let [x_mm, y_mm] = feature.place_mm;
            let q = forward * Vector3::new(x_mm, y_mm, 1.0);
            let [px, py] = stated_place(&camera.lens, [q.x / q.z, q.y / q.z]);
            if !(px >= 0.0 && py >= 0.0 && px < width && py < height) {
                continue;
            }
            let (x, y) = (px as usize, py as usize);
            let Some(light) = camera.light(&key.samples, x, y) else { continue };
            let late = y as f64 - camera.middle_row();
            let (place, slopes) = warps[y].slopes(camera.ray(x, y));
            let [value, dx, dy] = self.map.sample(place);
            if !(value.is_finite() && dx.is_finite() && dy.is_finite()) {
                continue;
            }
            let expected = level * value;
            let mut row = [0.0; N];
            for (part, [sx, sy]) in row.iter_mut().zip(slopes) {
                *part = level * (dx * sx + dy * sy);
            }
            row[W] = expected;
            if N > W + 1 {
                row[W + 1] = (0..POSE_DOF).map(|i| row[i] * key.speed[i] * late).sum();
            }
            let residual = f64::from(light) - expected;
            // Noise scales inversely with the gain of the Bayer site.
            let precision = f64::from(camera.weight(x, y)) / self.noise.variance(expected);
            let sigmas = residual.abs() * precision.sqrt();
            let weight =
                precision * if sigmas > HUBER_SIGMAS { HUBER_SIGMAS / sigmas } else { 1.0 };
            weighted_squares += weight * residual * residual;
            n += 1;
            n_agreeing += usize::from(sigmas <= HUBER_SIGMAS);
            let of_part = &mut by_part[number * MAP_PARTS / self.features.len()];
            for i in 0..N {
                let part = weight * row[i];
                right[i] += part * residual;
                of_part[i] += part * residual;
                for j in i..N {
                    normal[i][j] += part * row[j];
                }
            }
        }
        Some(FrameEquations {
            normal: SMatrix::from_fn(|i, j| normal[i.min(j)][i.max(j)]),
            right: SVector::from(right),
            weighted_squares,
            n,
            n_agreeing,
            by_part,
        })
    }

    fn warps_of_rows<const W: usize>(
        &self,
        key: &Keyframe,
        steps: &[f64; W],
    ) -> Option<Vec<Warp<W>>> {
        let optics = self.optics;
        let n_rows = usize::from(optics.camera.size.height);
        let last = (n_rows as f64 - 1.0).max(1.0);
        let anchor = |i: usize| {
            let row = last * i as f64 / (ANCHOR_ROWS - 1) as f64;
            let pose = optics.pose_of_row(key, row);
            Warp::new(steps, |by| {
                let moved = std::array::from_fn(|i| pose[i] + by.get(i).copied().unwrap_or(0.0));
                let head = moved_head(&optics.head, by);
                head.plane_from_pi(&moved)
            })
        };
        let anchors: Option<Vec<Warp<W>>> = (0..ANCHOR_ROWS).map(anchor).collect();
        let anchors = anchors?;
        Some((0..n_rows).map(|row| between(&anchors, row as f64 / last)).collect())
    }
}

/// The head changed by the entries that follow the pose, if there are any.
fn moved_head(head: &HeadGeometry, by: &[f64]) -> HeadGeometry {
    match by.get(POSE_DOF..POSE_DOF + HEAD_DOF) {
        Some(&[a, b, c, d]) => head.moved(&[a, b, c, d]),
        _ => *head,
    }
}

#[inline]
fn between<const W: usize>(anchors: &[Warp<W>], part: f64) -> Warp<W> {
    let position = part.clamp(0.0, 1.0) * (anchors.len() - 1) as f64;
    let i = (position as usize).min(anchors.len().saturating_sub(2));
    anchors[i].blend(&anchors[i + 1], position - i as f64)
}
