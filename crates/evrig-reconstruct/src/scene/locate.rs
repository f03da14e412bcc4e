//! Pose of one frame against the map by Gauss-Newton.

use super::align::{ALL, OWN, Reference, SHARED};
use super::head::HeadPose;
use super::path::PathKnot;
use super::robust::clustered;
use super::splat::Key;
use super::squares::Squares;
use nalgebra::{SMatrix, SVector};

/// Convergence threshold of a step, pixels. Steps shrink by a factor of five or more, so that a
/// fifth of it remains.
const SETTLED_PX: f64 = 0.01;

const MOST_STEPS: usize = 12;

/// A located frame with its visible features and those that agree with the map.
#[derive(Debug, Clone)]
pub(super) struct Located {
    pub(super) knot: PathKnot,
    pub(super) n: usize,
    pub(super) n_fit: usize,
    /// Logarithm of its brightness over the map's on the coarse grid.
    pub(super) levels: Vec<f32>,
}

/// Aligns a frame to the map from a nearby start.
pub(super) fn locate(reference: &Reference<'_>, mut key: Key) -> Option<Located> {
    let focal = reference.optics.camera.lens.focal_px;
    // Features that agree in one step and not in the next can make the iteration oscillate: the
    // step is halved on every reversal.
    let (mut made, mut last) = (1.0, [0.0; 2]);
    for _ in 0..MOST_STEPS {
        let equations = reference.own(&key)?;
        if equations.n < 50 * OWN {
            return None;
        }
        let inverse = equations.normal.try_inverse()?;
        let change = inverse * equations.right;
        if change[0] * last[0] + change[1] * last[1] < 0.0 {
            made *= 0.5;
        }
        last = [change[0], change[1]];
        (0..4).for_each(|i| key.pose[i] += made * change[i]);
        key.ln_gain += made * change[4];
        let moved_px = change[0].hypot(change[1]) * focal / key.pose[2];
        if moved_px < SETTLED_PX {
            let misfit = equations.squares / equations.n as f64;
            // The remaining step is distributed over the parts.
            let share = 1.0 / equations.by_part.len().max(1) as f64;
            let score = |part: &SVector<f64, OWN>| part - equations.normal * change * share;
            let scores: Vec<_> = equations.by_part.iter().map(score).collect();
            let together = clustered(&inverse, &scores);
            let pose_error: HeadPose = std::array::from_fn(|i| {
                (inverse[(i, i)] * misfit).max(together[(i, i)]).max(0.0).sqrt()
            });
            let time_s = reference.optics.middle_s(key.first_s);
            let misfit = misfit.sqrt();
            let ln_gain = reference.ln_level(&key).unwrap_or(key.ln_gain);
            let pose = key.pose;
            let knot = PathKnot { time_s, pose, pose_error, ln_gain, misfit };
            let Reference { optics, map, .. } = reference;
            let levels = Squares::covering(&map.grid).levels(optics, map, &key);
            return Some(Located { knot, n: equations.n, n_fit: equations.n_fit, levels });
        }
    }
    None
}

/// A frame's equations with its own unknowns eliminated (Schur complement).
pub(super) struct Part {
    pub(super) normal: SMatrix<f64, SHARED, SHARED>,
    pub(super) right: SVector<f64, SHARED>,
    /// The frame's own change is `own_right - own_shared * shared`.
    pub(super) own_right: SVector<f64, OWN>,
    pub(super) own_shared: SMatrix<f64, OWN, SHARED>,
}

pub(super) fn split(normal: &SMatrix<f64, ALL, ALL>, right: &SVector<f64, ALL>) -> Option<Part> {
    let own = normal.fixed_view::<OWN, OWN>(0, 0).into_owned().try_inverse()?;
    let across = normal.fixed_view::<OWN, SHARED>(0, OWN).into_owned();
    let rest = normal.fixed_view::<SHARED, SHARED>(OWN, OWN).into_owned();
    let (own_right, own_shared) = (own * right.fixed_rows::<OWN>(0), own * across);
    Some(Part {
        normal: rest - across.transpose() * own_shared,
        right: right.fixed_rows::<SHARED>(OWN) - across.transpose() * own_right,
        own_right,
        own_shared,
    })
}
