//! Start poses of the head from the tag in the Pi's frames.

use super::head::{HeadGeometry, HeadPose, POSE_DOF};
use crate::roi::Track;
use evrig_core::time::{PiSensor, Span, Stamp};
use nalgebra::{SMatrix, SVector, Vector3};

/// Corners of the tag, millimetres on the target.
#[derive(Debug, Clone, Copy)]
pub(super) struct TagSquare(pub(super) TagCorners);

pub(super) struct TagPath<'a> {
    track: &'a Track<PiSensor>,
    pub(super) zero: Stamp<PiSensor>,
    pub(super) square: TagSquare,
    pub(super) head: HeadGeometry,
}

/// Four corners: millimetres on the target, or rays of the camera.
pub(super) type TagCorners = [[f64; 2]; 4];

impl<'a> TagPath<'a> {
    /// The path of a track, with wrist rotation zero at its first detection.
    pub(super) fn new(track: &'a Track<PiSensor>, stated: HeadGeometry) -> Option<Self> {
        let zero = track.span()?[0];
        let square = TagSquare(track.plane.tag_corners_mm());
        let mut path = Self { track, zero, square, head: stated };
        path.head.roll_rad = similarity(&square.0, &path.rays(zero)?).1;
        Some(path)
    }

    /// Rays to the corners at `n` instants spread over the track, where it is known.
    pub(super) fn views(&self, n: usize) -> Vec<TagCorners> {
        let [from, to] = self.span_s();
        let time_s = |i: usize| from + (to - from) * (i as f64 + 0.5) / n as f64;
        let rays = |i: usize| self.rays(self.zero + Span::from_secs_f64(time_s(i)));
        (0..n).filter_map(rays).collect()
    }

    pub(super) fn span_s(&self) -> [f64; 2] {
        self.track.span().map_or([0.0; 2], |span| span.map(|at| (at - self.zero).as_secs_f64()))
    }

    /// Pose and its derivative at a time; None where the track has a gap.
    pub(super) fn pose(&self, time_s: f64) -> Option<(HeadPose, HeadPose)> {
        let step_s = 2e-3;
        let here = self.pose_at(time_s)?;
        let (before, after) = (self.pose_at(time_s - step_s), self.pose_at(time_s + step_s));
        let change = |a: HeadPose, b: HeadPose, length_s: f64| -> HeadPose {
            std::array::from_fn(|i| (b[i] - a[i]) / length_s)
        };
        let speed = match (before, after) {
            (Some(a), Some(b)) => change(a, b, 2.0 * step_s),
            (Some(a), None) => change(a, here, step_s),
            (None, Some(b)) => change(here, b, step_s),
            (None, None) => [0.0; POSE_DOF],
        };
        Some((here, speed))
    }

    fn pose_at(&self, time_s: f64) -> Option<HeadPose> {
        let rays = self.rays(self.zero + Span::from_secs_f64(time_s))?;
        self.square.pose(&self.head, &rays)
    }

    fn rays(&self, time: Stamp<PiSensor>) -> Option<TagCorners> {
        let view = self.track.at(time).ok()?;
        let lens = &self.track.lens;
        let [cx, cy] = lens.centre_px;
        Some(self.square.0.map(|corner| {
            let [x, y] = view.homography().apply(corner);
            [(x - cx) / lens.focal_px, (y - cy) / lens.focal_px]
        }))
    }
}

impl TagSquare {
    /// The pose with the least reprojection error.
    pub(super) fn pose(&self, head: &HeadGeometry, seen: &TagCorners) -> Option<HeadPose> {
        let (scale, angle, shift) = similarity(&self.0, seen);
        let distance = 1.0 / scale;
        // A wrist axis parallel to the optical axis gives the rotation directly.
        let forward = head.axis[2];
        let apart = wrapped(head.roll_rad - angle);
        let turn = if forward.abs() > 0.5 { apart / forward } else { 0.0 };
        let (sin, cos) = (turn * forward).sin_cos();
        let back = [cos * shift[0] - sin * shift[1], sin * shift[0] + cos * shift[1]];
        let mut pose = [-back[0] * distance, -back[1] * distance, distance, turn];
        let target = SVector::<f64, 8>::from_fn(|i, _| seen[i / 2][i % 2]);
        for _ in 0..6 {
            let slopes = self.pose_derivatives(head, &pose);
            let normal = slopes.transpose() * slopes;
            let left = target - self.rays(head, &pose);
            let change = normal.cholesky()?.solve(&(slopes.transpose() * left));
            (0..POSE_DOF).for_each(|i| pose[i] += change[i]);
        }
        (pose.iter().all(|part| part.is_finite()) && pose[2] > 0.0).then_some(pose)
    }

    /// Rays to the corners, right and down of each in turn.
    pub(super) fn rays(&self, head: &HeadGeometry, pose: &HeadPose) -> SVector<f64, 8> {
        let matrix = head.pi_from_plane(pose);
        SVector::from_fn(|i, _| {
            let q = matrix * Vector3::new(self.0[i / 2][0], self.0[i / 2][1], 1.0);
            q[i % 2] / q.z
        })
    }

    pub(super) fn pose_derivatives(
        &self,
        head: &HeadGeometry,
        pose: &HeadPose,
    ) -> SMatrix<f64, 8, POSE_DOF> {
        let steps = [1e-3, 1e-3, 1e-2, 1e-6];
        let here = self.rays(head, pose);
        let mut slopes = SMatrix::<f64, 8, POSE_DOF>::zeros();
        for (i, step) in steps.into_iter().enumerate() {
            let mut moved = *pose;
            moved[i] += step;
            slopes.set_column(i, &((self.rays(head, &moved) - here) / step));
        }
        slopes
    }
}

/// Least-squares similarity from positions to rays: scale, angle, shift.
fn similarity(places: &TagCorners, rays: &TagCorners) -> (f64, f64, [f64; 2]) {
    let mean =
        |points: &TagCorners| [0, 1].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / 4.0);
    let (p0, r0) = (mean(places), mean(rays));
    let (mut along, mut across, mut square) = (0.0, 0.0, 0.0);
    for (place, ray) in places.iter().zip(rays) {
        let (px, py) = (place[0] - p0[0], place[1] - p0[1]);
        let (rx, ry) = (ray[0] - r0[0], ray[1] - r0[1]);
        along += px * rx + py * ry;
        across += px * ry - py * rx;
        square += px * px + py * py;
    }
    let (a, b) = (along / square, across / square);
    let shift = [r0[0] - a * p0[0] + b * p0[1], r0[1] - b * p0[0] - a * p0[1]];
    (a.hypot(b), b.atan2(a), shift)
}

/// An angle wrapped to ±π.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_similarity_is_read_off_four_corners() {
        let places = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
        let (scale, angle) = (0.004_f64, -0.7_f64);
        let (a, b) = (scale * angle.cos(), scale * angle.sin());
        let rays = places.map(|[x, y]| [a * x - b * y + 0.1, b * x + a * y - 0.2]);
        let (got, turned, shift) = similarity(&places, &rays);
        assert!((got - scale).abs() < 1e-12 && (turned - angle).abs() < 1e-12);
        assert!((shift[0] - 0.1).abs() < 1e-12 && (shift[1] + 0.2).abs() < 1e-12);
    }
}
