//! Tilts of the target and of the wrist's axis from the tag's perspective.
//!
//! The map cannot show a tilt of the target: the map made from the same frames tilts along, and a
//! distance that changes with position, or the row time, absorbs the rest. The shape of the tag
//! does not depend on the map. A tilt changes it by about a hundredth of a pixel per milliradian
//! off the optical axis; errors from the pixel phase of the corners average out over a track. A
//! lens that differs from the rig description has the same effect as a tilt.

use super::clustered_covariance::clustered_covariance;
use super::head::{HEAD_DOF, HeadGeometry};
use super::tag_pose::{TagCorners, TagPath, TagSquare};
use nalgebra::{SMatrix, SVector};

/// Instants sampled from the track.
const INSTANTS: usize = 240;
/// Fewest observations.
const MIN_OBSERVATIONS: usize = 12;
/// Gauss-Newton iterations.
const ITERATIONS: usize = 6;
/// Prior standard deviation of the tilts, radians.
const TILT_RAD: f64 = 0.02;
/// Systematic error of the tag's perspective, radians: lens model and common corner errors.
const FLOOR_RAD: f64 = 1e-3;
/// Step of the numerical derivatives.
const HEAD_STEP: f64 = 1e-5;

/// Tilts estimated from the tag, with their information matrix.
#[derive(Debug, Clone, Copy)]
pub(super) struct TagTilt {
    pub(super) head: HeadGeometry,
    /// Inverse covariance, in the order of [`HeadGeometry::moved`].
    pub(super) information: SMatrix<f64, HEAD_DOF, HEAD_DOF>,
}

/// Equations for the tilts with the poses eliminated.
struct TiltEquations {
    normal: SMatrix<f64, HEAD_DOF, HEAD_DOF>,
    right: SVector<f64, HEAD_DOF>,
    scores: Vec<SVector<f64, HEAD_DOF>>,
    squares: f64,
}

impl TagTilt {
    pub(super) fn by(tag: &TagPath<'_>) -> Self {
        Self::of(tag.square, tag.head, &tag.views(INSTANTS))
    }

    /// From observations of the tag, for a nominal head.
    fn of(square: TagSquare, stated: HeadGeometry, views: &[TagCorners]) -> Self {
        let before = SMatrix::<f64, HEAD_DOF, HEAD_DOF>::identity() * TILT_RAD.powi(-2);
        let unknown = Self { head: stated, information: before };
        let mut estimate = unknown;
        for round in 0..ITERATIONS {
            let equations = TiltEquations::over(square, &estimate.head, views);
            let n = equations.scores.len();
            if n < MIN_OBSERVATIONS {
                return unknown;
            }
            let variance = (equations.squares / (4 * n - HEAD_DOF) as f64).max(f64::MIN_POSITIVE);
            let (normal, right) = (equations.normal / variance, equations.right / variance);
            let Some(inverse) = (normal + before).try_inverse() else { return unknown };
            let change = inverse * (right - before * tilt_difference(&estimate.head, &stated));
            estimate.head = estimate.head.moved(&change.into());
            if round + 1 == ITERATIONS {
                estimate.information =
                    information(&normal, &inverse, &equations.scores, variance, &before);
            }
        }
        let is_sound = estimate.information.iter().all(|part| part.is_finite());
        if is_sound { estimate } else { unknown }
    }
}

pub(super) fn tilt_difference(head: &HeadGeometry, other: &HeadGeometry) -> SVector<f64, HEAD_DOF> {
    SVector::from([
        head.tilt_rad[0] - other.tilt_rad[0],
        head.tilt_rad[1] - other.tilt_rad[1],
        head.axis_tilt_rad[0] - other.axis_tilt_rad[0],
        head.axis_tilt_rad[1] - other.axis_tilt_rad[1],
    ])
}

/// Information after clustering of neighbouring observations, bounded by [`FLOOR_RAD`].
fn information(
    normal: &SMatrix<f64, HEAD_DOF, HEAD_DOF>,
    inverse: &SMatrix<f64, HEAD_DOF, HEAD_DOF>,
    scores: &[SVector<f64, HEAD_DOF>],
    variance: f64,
    before: &SMatrix<f64, HEAD_DOF, HEAD_DOF>,
) -> SMatrix<f64, HEAD_DOF, HEAD_DOF> {
    let scores: Vec<_> = scores.iter().map(|score| score / variance).collect();
    let together = clustered_covariance(inverse, &scores);
    let factor = (0..HEAD_DOF).map(|i| together[(i, i)] / inverse[(i, i)]).fold(1.0, f64::max);
    let floor = SMatrix::<f64, HEAD_DOF, HEAD_DOF>::identity() * FLOOR_RAD.powi(2);
    let covariance = (normal / factor + before).try_inverse().map(|own| own + floor);
    covariance.and_then(|covariance| covariance.try_inverse()).unwrap_or(*before)
}

impl TiltEquations {
    fn over(square: TagSquare, head: &HeadGeometry, views: &[TagCorners]) -> Self {
        let (normal, right) = (SMatrix::zeros(), SVector::zeros());
        let mut equations = Self { normal, right, scores: Vec::new(), squares: 0.0 };
        for view in views {
            // Observations without a valid pose are skipped.
            let _ = equations.add(square, head, view);
        }
        equations
    }

    fn add(&mut self, square: TagSquare, head: &HeadGeometry, view: &TagCorners) -> Option<()> {
        let pose = square.pose(head, view)?;
        let here = square.rays(head, &pose);
        let residual = SVector::<f64, 8>::from_fn(|i, _| view[i / 2][i % 2]) - here;
        let mut shared = SMatrix::<f64, 8, HEAD_DOF>::zeros();
        for i in 0..HEAD_DOF {
            let mut by = [0.0; HEAD_DOF];
            by[i] = HEAD_STEP;
            shared.set_column(i, &((square.rays(&head.moved(&by), &pose) - here) / HEAD_STEP));
        }
        // Projects out what the pose can absorb.
        let own = square.pose_derivatives(head, &pose);
        let onto_pose = (own.transpose() * own).try_inverse()? * own.transpose();
        let residual = residual - own * (onto_pose * residual);
        let shared = shared - own * (onto_pose * shared);
        let score = shared.transpose() * residual;
        self.normal += shared.transpose() * shared;
        self.right += score;
        self.scores.push(score);
        self.squares += residual.norm_squared();
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: TagCorners = [[-7.0, 7.0], [7.0, 7.0], [7.0, -7.0], [-7.0, -7.0]];

    fn head(tilt_rad: [f64; 2], axis_tilt_rad: [f64; 2]) -> HeadGeometry {
        HeadGeometry { roll_rad: 0.3, tilt_rad, axis: [0.0, 0.0, 1.0], axis_tilt_rad }
    }

    /// Views from a circle on which the wrist rotates by `turn` radians, with an error of each
    /// coordinate within ±`wrong`.
    fn views(truth: &HeadGeometry, turn: f64, wrong: f64) -> Vec<TagCorners> {
        let square = TagSquare(CORNERS);
        (0..200_u32)
            .map(|k| {
                let phase = 0.1 * f64::from(k);
                let place = [12.0 * phase.cos(), 12.0 * phase.sin()];
                let pose = [place[0], place[1], 225.0, turn * (0.7 * phase).sin()];
                let rays = square.rays(truth, &pose);
                std::array::from_fn(|i| {
                    [0, 1].map(|axis| {
                        let mixed = (8 * k + (2 * i + axis) as u32).wrapping_mul(2_654_435_761);
                        rays[2 * i + axis] + wrong * (f64::from(mixed >> 16) / 32_768.0 - 1.0)
                    })
                })
            })
            .collect()
    }

    #[test]
    fn a_planted_tilt_of_the_target_comes_back_within_its_error() {
        let truth = head([0.015, -0.008], [0.0; 2]);
        // Two hundredths of a pixel at 1700 pixels per radian.
        let found =
            TagTilt::of(TagSquare(CORNERS), head([0.0; 2], [0.0; 2]), &views(&truth, 0.0, 1.2e-5));
        let covariance = found.information.try_inverse().unwrap();
        for i in 0..2 {
            let (off, error) =
                (found.head.tilt_rad[i] - truth.tilt_rad[i], covariance[(i, i)].sqrt());
            assert!(off.abs() < 3.0 * error && error < 2e-3, "{off} {error}");
            // A wrist at rest does not determine its axis.
            assert!(covariance[(2 + i, 2 + i)].sqrt() > 0.9 * TILT_RAD);
        }
    }

    #[test]
    fn a_wrist_that_swings_shows_its_axis_too() {
        let truth = head([0.004, 0.011], [-0.006, 0.009]);
        let found =
            TagTilt::of(TagSquare(CORNERS), head([0.0; 2], [0.0; 2]), &views(&truth, 0.3, 1e-7));
        for i in 0..2 {
            assert!((found.head.tilt_rad[i] - truth.tilt_rad[i]).abs() < 1e-3, "{found:?}");
            assert!(
                (found.head.axis_tilt_rad[i] - truth.axis_tilt_rad[i]).abs() < 3e-3,
                "{found:?}"
            );
        }
    }

    #[test]
    fn too_few_looks_leave_what_is_stated() {
        let truth = head([0.015, -0.008], [0.0; 2]);
        let few = &views(&truth, 0.0, 0.0)[..MIN_OBSERVATIONS - 1];
        let found = TagTilt::of(TagSquare(CORNERS), head([0.0; 2], [0.0; 2]), few);
        assert_eq!(found.head.tilt_rad, [0.0; 2]);
    }
}
