//! A frame against the map: equations for its pose, its brightness and what all frames share.

use super::head::{HEAD, Head, POSE, stated_place};
use super::looks::looks;
use super::map::{Mark, RadianceMap};
use super::splat::{Key, Optics};
use super::warp::Warp;
use nalgebra::{SMatrix, SVector, Vector3};

/// Unknowns of one frame: pose and logarithm of brightness.
pub(super) const OWN: usize = POSE + 1;

/// Unknowns that all frames share: the head's constants and the row time.
pub(super) const SHARED: usize = HEAD + 1;

/// All unknowns, the frame's own first.
pub(super) const ALL: usize = OWN + SHARED;

/// Normal equations of one frame.
#[derive(Debug, Clone)]
pub(super) struct Equations<const N: usize> {
    pub(super) normal: SMatrix<f64, N, N>,
    pub(super) right: SVector<f64, N>,
    /// Weighted squares of what is left, in units of the noise that was assumed.
    pub(super) squares: f64,
    pub(super) n: usize,
    /// Marks that look as expected, noise allowed for.
    pub(super) n_fit: usize,
    /// The right side by parts of the map, which are wrong apart from each other.
    pub(super) by_part: Vec<SVector<f64, N>>,
}

/// Steps by which the pose and the head's constants are moved to get slopes.
const POSE_STEPS: [f64; POSE] = [1e-3, 1e-3, 1e-2, 1e-6];
const HEAD_STEPS: [f64; HEAD] = [1e-5; HEAD];

/// A residual beyond so many standard deviations is trusted in proportion less (Huber's rule).
const HUBER: f64 = 2.5;

/// Parts of the map, each of marks near each other, for what is left unexplained in common.
const PARTS: usize = 32;

/// Rows between which a frame's geometry is taken as straight in time.
const ANCHORS: usize = 9;

/// Rows, and columns, between pixels whose light is summed for a frame's level: odd, so that all places
/// of the mosaic have their turn.
pub(super) const LEVEL_STEP: usize = 7;

/// Fewer pixels on the map tell no level.
const LEAST_LEVEL: usize = 200;

/// Noise of a pixel: variance grows with light from a floor, both in DN.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    pub(super) variance_per_dn: f64,
    pub(super) floor_dn: f64,
}

impl Noise {
    fn variance(&self, light_dn: f64) -> f64 {
        self.variance_per_dn * (light_dn.max(0.0) + self.floor_dn)
    }
}

/// What frames are held against.
pub(super) struct Reference<'a> {
    pub(super) optics: &'a Optics,
    pub(super) map: &'a RadianceMap,
    pub(super) marks: &'a [Mark],
    pub(super) noise: Noise,
}

impl Reference<'_> {
    /// Logarithm of a frame's light over that of the map: of the sums over pixels all over the frame.
    ///
    /// The level that goes with a pose in the equations is no measure of it. Edges are all that these
    /// look at, and the dark side of each counts most; a frame that moves is more blurred than the map,
    /// which makes that side brighter. A sum over the whole keeps its light however it is blurred.
    pub(super) fn ln_level(&self, key: &Key) -> Option<f64> {
        let (mut seen, mut expected, mut n) = (0.0_f64, 0.0_f64, 0_usize);
        looks(self.optics, self.map, key, LEVEL_STEP, |look| {
            (seen, expected, n) = (seen + look.light, expected + look.mapped[0], n + 1);
        })?;
        let is_known = n >= LEAST_LEVEL && seen > 0.0 && expected > 0.0;
        is_known.then(|| (seen / expected).ln())
    }

    /// Equations for pose and brightness alone.
    pub(super) fn own(&self, key: &Key) -> Option<Equations<OWN>> {
        self.equations::<POSE, OWN>(key, &POSE_STEPS)
    }

    /// Equations for everything, in the order own, head, row time.
    pub(super) fn all(&self, key: &Key) -> Option<Equations<ALL>> {
        let mut steps = [0.0; POSE + HEAD];
        steps[..POSE].copy_from_slice(&POSE_STEPS);
        steps[POSE..].copy_from_slice(&HEAD_STEPS);
        let mixed = self.equations::<{ POSE + HEAD }, ALL>(key, &steps)?;
        // From (pose, head, brightness, row) to (pose, brightness, head, row).
        let order: [usize; ALL] = std::array::from_fn(|i| match i {
            i if i < POSE => i,
            POSE => POSE + HEAD,
            i if i < ALL - 1 => i - 1,
            i => i,
        });
        Some(Equations {
            normal: SMatrix::from_fn(|i, j| mixed.normal[(order[i], order[j])]),
            right: SVector::from_fn(|i, _| mixed.right[order[i]]),
            squares: mixed.squares,
            n: mixed.n,
            n_fit: mixed.n_fit,
            by_part: Vec::new(),
        })
    }

    /// `W` parameters of geometry, then brightness, then (where `N` leaves room) the row time.
    fn equations<const W: usize, const N: usize>(
        &self,
        key: &Key,
        steps: &[f64; W],
    ) -> Option<Equations<N>> {
        let Optics { camera, head, .. } = self.optics;
        let (width, height) = (f64::from(camera.size.width), f64::from(camera.size.height));
        let warps = self.warps_of_rows(key, steps)?;
        let forward = head.pi_from_plane(&key.pose);
        let level = key.ln_gain.exp();
        let mut normal = [[0.0; N]; N];
        let mut right = [0.0; N];
        let (mut squares, mut n, mut n_fit) = (0.0, 0_usize, 0_usize);
        let mut by_part = vec![SVector::<f64, N>::zeros(); PARTS];
        for (mark, number) in self.marks.iter().zip(0..) {
            let [x_mm, y_mm] = mark.place_mm;
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
                row[W + 1] = (0..POSE).map(|i| row[i] * key.speed[i] * late).sum();
            }
            let left = f64::from(light) - expected;
            // A place of lower gain is noisier by as much.
            let precision = f64::from(camera.weight(x, y)) / self.noise.variance(expected);
            let sigmas = left.abs() * precision.sqrt();
            let weight = precision * if sigmas > HUBER { HUBER / sigmas } else { 1.0 };
            squares += weight * left * left;
            n += 1;
            n_fit += usize::from(sigmas <= HUBER);
            let of_part = &mut by_part[number * PARTS / self.marks.len()];
            for i in 0..N {
                let part = weight * row[i];
                right[i] += part * left;
                of_part[i] += part * left;
                for j in i..N {
                    normal[i][j] += part * row[j];
                }
            }
        }
        Some(Equations {
            normal: SMatrix::from_fn(|i, j| normal[i.min(j)][i.max(j)]),
            right: SVector::from(right),
            squares,
            n,
            n_fit,
            by_part,
        })
    }

    /// The frame's geometry row by row: exact at some of them, straight in between.
    fn warps_of_rows<const W: usize>(&self, key: &Key, steps: &[f64; W]) -> Option<Vec<Warp<W>>> {
        let optics = self.optics;
        let n_rows = usize::from(optics.camera.size.height);
        let last = (n_rows as f64 - 1.0).max(1.0);
        let anchor = |i: usize| {
            let row = last * i as f64 / (ANCHORS - 1) as f64;
            let pose = optics.pose_of_row(key, row);
            Warp::new(steps, |by| {
                let moved = std::array::from_fn(|i| pose[i] + by.get(i).copied().unwrap_or(0.0));
                let head = moved_head(&optics.head, by);
                head.plane_from_pi(&moved)
            })
        };
        let anchors: Option<Vec<Warp<W>>> = (0..ANCHORS).map(anchor).collect();
        let anchors = anchors?;
        Some((0..n_rows).map(|row| between(&anchors, row as f64 / last)).collect())
    }
}

/// The head moved by what follows the pose in a list of changes, if anything does.
fn moved_head(head: &Head, by: &[f64]) -> Head {
    match by.get(POSE..POSE + HEAD) {
        Some(&[a, b, c, d]) => head.moved(&[a, b, c, d]),
        _ => *head,
    }
}

/// The geometry at a share of the rows.
#[inline]
fn between<const W: usize>(anchors: &[Warp<W>], part: f64) -> Warp<W> {
    let position = part.clamp(0.0, 1.0) * (anchors.len() - 1) as f64;
    let i = (position as usize).min(anchors.len().saturating_sub(2));
    anchors[i].blend(&anchors[i + 1], position - i as f64)
}
