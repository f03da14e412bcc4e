//! Pose of one frame against the map by Gauss-Newton.

use super::accumulate::Keyframe;
use super::clustered_covariance::clustered_covariance;
use super::coarse_grid::CoarseGrid;
use super::head::HeadPose;
use super::path::PathKnot;
use super::photometric::{ALL_UNKNOWNS, FRAME_UNKNOWNS, MapReference, SHARED_UNKNOWNS};
use nalgebra::{SMatrix, SVector};

/// Convergence threshold of a step, pixels. Steps shrink by a factor of five or more, so that a
/// fifth of it remains.
const CONVERGED_PX: f64 = 0.01;
const MAX_STEPS: usize = 12;

/// A located frame with its visible features and those that agree with the map.
#[derive(Debug, Clone)]
pub(super) struct LocatedFrame {
    pub(super) knot: PathKnot,
    pub(super) n: usize,
    pub(super) n_agreeing: usize,
    /// Logarithm of its brightness over the map's on the coarse grid.
    pub(super) levels: Vec<f32>,
}

/// Aligns a frame to the map from a nearby start.
pub(super) fn locate(reference: &MapReference<'_>, mut key: Keyframe) -> Option<LocatedFrame> {
    let focal = reference.optics.camera.lens.focal_px;
    // Features that agree in one step and not in the next can make the iteration oscillate: the
    // step is halved on every reversal.
    let (mut step_scale, mut last) = (1.0, [0.0; 2]);
    for _ in 0..MAX_STEPS {
        let equations = reference.frame_equations(&key)?;
        if equations.n < 50 * FRAME_UNKNOWNS {
            return None;
        }
        let inverse = equations.normal.try_inverse()?;
        let change = inverse * equations.right;
        if change[0] * last[0] + change[1] * last[1] < 0.0 {
            step_scale *= 0.5;
        }
        last = [change[0], change[1]];
        (0..4).for_each(|i| key.pose[i] += step_scale * change[i]);
        key.ln_gain += step_scale * change[4];
        let moved_px = change[0].hypot(change[1]) * focal / key.pose[2];
        if moved_px < CONVERGED_PX {
            let misfit = equations.weighted_squares / equations.n as f64;
            // The remaining step is distributed over the parts.
            let share = 1.0 / equations.by_part.len().max(1) as f64;
            let score =
                |part: &SVector<f64, FRAME_UNKNOWNS>| part - equations.normal * change * share;
            let scores: Vec<_> = equations.by_part.iter().map(score).collect();
            let together = clustered_covariance(&inverse, &scores);
            let pose_error: HeadPose = std::array::from_fn(|i| {
                (inverse[(i, i)] * misfit).max(together[(i, i)]).max(0.0).sqrt()
            });
            let time_s = reference.optics.middle_s(key.first_s);
            let misfit = misfit.sqrt();
            let ln_gain = reference.ln_level(&key).unwrap_or(key.ln_gain);
            let pose = key.pose;
            let knot = PathKnot { time_s, pose, pose_error, ln_gain, misfit };
            let MapReference { optics, map, .. } = reference;
            let levels = CoarseGrid::covering(&map.grid).levels(optics, map, &key);
            return Some(LocatedFrame {
                knot,
                n: equations.n,
                n_agreeing: equations.n_agreeing,
                levels,
            });
        }
    }
    None
}

/// A frame's equations with its own unknowns eliminated (Schur complement).
pub(super) struct ReducedEquations {
    pub(super) normal: SMatrix<f64, SHARED_UNKNOWNS, SHARED_UNKNOWNS>,
    pub(super) right: SVector<f64, SHARED_UNKNOWNS>,
    /// The frame's own change is `own_right - own_shared * shared`.
    pub(super) own_right: SVector<f64, FRAME_UNKNOWNS>,
    pub(super) own_shared: SMatrix<f64, FRAME_UNKNOWNS, SHARED_UNKNOWNS>,
}

pub(super) fn eliminate_pose(
    normal: &SMatrix<f64, ALL_UNKNOWNS, ALL_UNKNOWNS>,
    right: &SVector<f64, ALL_UNKNOWNS>,
) -> Option<ReducedEquations> {
    let own =
        normal.fixed_view::<FRAME_UNKNOWNS, FRAME_UNKNOWNS>(0, 0).into_owned().try_inverse()?;
    let across =
        normal.fixed_view::<FRAME_UNKNOWNS, SHARED_UNKNOWNS>(0, FRAME_UNKNOWNS).into_owned();
    let rest = normal
        .fixed_view::<SHARED_UNKNOWNS, SHARED_UNKNOWNS>(FRAME_UNKNOWNS, FRAME_UNKNOWNS)
        .into_owned();
    let (own_right, own_shared) = (own * right.fixed_rows::<FRAME_UNKNOWNS>(0), own * across);
    Some(ReducedEquations {
        normal: rest - across.transpose() * own_shared,
        right: right.fixed_rows::<SHARED_UNKNOWNS>(FRAME_UNKNOWNS) - across.transpose() * own_right,
        own_right,
        own_shared,
    })
}
