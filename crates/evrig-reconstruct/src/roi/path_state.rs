//! State of the target's path and its projection.
//!
//! From the target plane to ideal pixels the model is `image = shape o similarity(t)`: a similarity
//! that moves, followed by a map that does not. It is exact for a camera that translates in any
//! direction, and for one that also rotates about an axis perpendicular to the target, as an arm
//! with an upright wrist over a flat target does. The shape (two parameters of foreshortening, two
//! of tilt) may drift slowly.

use super::lens::Lens;
use super::target::TargetPlane;
use evrig_core::geometry::{Homography, UncertainHomography};
use nalgebra::{Matrix3, SMatrix, SVector};

/// Similarity: four positions, four speeds, four accelerations; then four of the shape.
pub(super) const N: usize = 16;
/// Parameters of a homography: similarity and shape.
pub(super) const M: usize = 8;
/// Index of the shape in the state.
pub(super) const SHAPE: usize = 12;

pub(super) type PathState = SVector<f64, N>;
pub(super) type Covariance = SMatrix<f64, N, N>;

/// Parametrisation of the states.
///
/// Positions are in pixels: `[a, b, x, y]` maps a plane point `p` (from the tag's centre, in half
/// sides of the tag) to `(a p.x - b p.y + x, b p.x + a p.y + y)`, from the optical axis. The shape
/// `[s, c, u, v]` then gives `((1+s) q.x + c q.y, c q.x + (1-s) q.y) / (1 + (u q.x + v q.y) / f)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct PathChart {
    centre_px: [f64; 2],
    focal_px: f64,
    middle_mm: [f64; 2],
    half_mm: f64,
}

/// The eight parameters of a homography.
pub(super) type Numbers = SVector<f64, M>;

impl PathChart {
    pub(super) fn new(lens: &Lens, plane: &TargetPlane) -> Self {
        Self {
            centre_px: lens.centre_px,
            focal_px: lens.focal_px,
            middle_mm: plane.tag_centre_mm(),
            half_mm: plane.tag_side_mm / 2.0,
        }
    }

    /// Ideal pixel of a plane point, and its derivatives by the eight parameters.
    pub(super) fn project(
        &self,
        numbers: &Numbers,
        point_mm: [f64; 2],
    ) -> ([f64; 2], SMatrix<f64, 2, M>) {
        let [x, y] = self.in_half_sides(point_mm);
        let [a, b, dx, dy, s, c, u, v] = (*numbers).into();
        let q = [a * x - b * y + dx, b * x + a * y + dy];
        let weight = 1.0 + (u * q[0] + v * q[1]) / self.focal_px;
        let image =
            [((1.0 + s) * q[0] + c * q[1]) / weight, (c * q[0] + (1.0 - s) * q[1]) / weight];
        let by_q = |row: usize, linear: [f64; 2]| {
            let part = |axis: usize, tilt: f64| {
                (linear[axis] - image[row] * tilt / self.focal_px) / weight
            };
            [part(0, u), part(1, v)]
        };
        let rows = [by_q(0, [1.0 + s, c]), by_q(1, [c, 1.0 - s])];
        let mut slope = SMatrix::zeros();
        for (row, [qx, qy]) in rows.into_iter().enumerate() {
            let by_shape = [[q[0], q[1]], [-q[1], q[0]]][row];
            let tilt = image[row] / (weight * self.focal_px);
            let parts = [
                qx * x + qy * y,
                qy * x - qx * y,
                qx,
                qy,
                by_shape[0] / weight,
                by_shape[1] / weight,
                -tilt * q[0],
                -tilt * q[1],
            ];
            for (column, part) in parts.into_iter().enumerate() {
                slope[(row, column)] = part;
            }
        }
        ([image[0] + self.centre_px[0], image[1] + self.centre_px[1]], slope)
    }

    /// The homography from plane millimetres to ideal pixels.
    pub(super) fn homography(&self, numbers: &Numbers) -> Homography {
        let [a, b, dx, dy, s, c, u, v] = (*numbers).into();
        let [mx, my] = self.middle_mm;
        let h = self.half_mm;
        let plane = Matrix3::new(1.0 / h, 0.0, -mx / h, 0.0, 1.0 / h, -my / h, 0.0, 0.0, 1.0);
        let similarity = Matrix3::new(a, -b, dx, b, a, dy, 0.0, 0.0, 1.0);
        let f = self.focal_px;
        let shape = Matrix3::new(1.0 + s, c, 0.0, c, 1.0 - s, 0.0, u / f, v / f, 1.0);
        let [cx, cy] = self.centre_px;
        let shift = Matrix3::new(1.0, 0.0, cx, 0.0, 1.0, cy, 0.0, 0.0, 1.0);
        Homography::from_matrix(shift * shape * similarity * plane)
    }

    /// The homography with the covariance of its elements, by numerical derivatives.
    pub(super) fn uncertain(
        &self,
        numbers: &Numbers,
        covariance: &SMatrix<f64, M, M>,
    ) -> UncertainHomography {
        let homography = self.homography(numbers);
        let elements = |homography: &Homography| {
            let matrix = homography.matrix();
            SVector::<f64, 9>::from_fn(|i, _| matrix[(i / 3, i % 3)])
        };
        let mut slope = SMatrix::<f64, 9, M>::zeros();
        for column in 0..M {
            let step = 1e-6 * (1.0 + numbers[column].abs());
            let [mut ahead, mut behind] = [*numbers, *numbers];
            ahead[column] += step;
            behind[column] -= step;
            let change = elements(&self.homography(&ahead)) - elements(&self.homography(&behind));
            slope.set_column(column, &(change / (2.0 * step)));
        }
        UncertainHomography { homography, covariance: slope * covariance * slope.transpose() }
    }

    /// The eight parameters of a homography; None for a plane seen from behind or edge-on.
    pub(super) fn numbers(&self, homography: &Homography) -> Option<Numbers> {
        let [cx, cy] = self.centre_px;
        let [mx, my] = self.middle_mm;
        let unshift = Matrix3::new(1.0, 0.0, -cx, 0.0, 1.0, -cy, 0.0, 0.0, 1.0);
        let h = self.half_mm;
        let from_half_sides = Matrix3::new(h, 0.0, mx, 0.0, h, my, 0.0, 0.0, 1.0);
        let matrix = unshift * homography.matrix() * from_half_sides;
        // The plane point on the optical axis, in half sides.
        let axis = matrix.try_inverse()? * nalgebra::Vector3::z();
        let [px, py] = [axis.x / axis.z, axis.y / axis.z];
        let weight = matrix[(2, 0)] * px + matrix[(2, 1)] * py + matrix[(2, 2)];
        let m = matrix / weight;
        // Around it, a symmetric linear part of trace two times a scaled rotation, and the tilt.
        let (m00, m01, m10, m11) = (m[(0, 0)], m[(0, 1)], m[(1, 0)], m[(1, 1)]);
        let determinant = m00 * m11 - m01 * m10;
        let size = (m00 * m00 + m01 * m01 + m10 * m10 + m11 * m11 + 2.0 * determinant).sqrt();
        // Polar decomposition of a 2 x 2 matrix: rotation along (m00 + m11, m10 - m01), trace
        // `size`.
        let (cos, sin) = ((m00 + m11) / size, (m10 - m01) / size);
        let scale = size / 2.0;
        let (a, b) = (scale * cos, scale * sin);
        let symmetric =
            |row0: f64, row1: f64, turn: [f64; 2]| (row0 * turn[0] + row1 * turn[1]) / scale;
        let s = symmetric(m00, m01, [cos, -sin]) - 1.0;
        let c = symmetric(m00, m01, [sin, cos]);
        let (dx, dy) = (-(a * px - b * py), -(b * px + a * py));
        let square = scale * scale / self.focal_px;
        let u = (m[(2, 0)] * a - m[(2, 1)] * b) / square;
        let v = (m[(2, 0)] * b + m[(2, 1)] * a) / square;
        let numbers = Numbers::from([a, b, dx, dy, s, c, u, v]);
        let is_sound = determinant > 0.0 && numbers.iter().all(|part| part.is_finite());
        is_sound.then_some(numbers)
    }

    fn in_half_sides(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x - self.middle_mm[0]) / self.half_mm, (y - self.middle_mm[1]) / self.half_mm]
    }
}

/// The eight parameters `delay` seconds after the state, and their derivatives by the state.
pub(super) fn numbers_after(state: &PathState, delay: f64) -> (Numbers, SMatrix<f64, M, N>) {
    let mut slope = SMatrix::<f64, M, N>::zeros();
    for i in 0..4 {
        slope[(i, i)] = 1.0;
        slope[(i, 4 + i)] = delay;
        slope[(i, 8 + i)] = delay * delay / 2.0;
        slope[(4 + i, SHAPE + i)] = 1.0;
    }
    (slope * state, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> PathChart {
        let lens = Lens { focal_px: 432.0, centre_px: [173.0, 130.0], distortion: [0.0; 5] };
        let plane = TargetPlane { tag_side_mm: 14.35, picture_side_mm: 43.05, gap_mm: 4.1 };
        PathChart::new(&lens, &plane)
    }

    const NUMBERS: [f64; 8] = [10.0, -9.0, 60.0, -30.0, 0.03, -0.02, 0.1, -0.15];

    #[test]
    fn a_homography_is_taken_apart_and_put_together() {
        let numbers = Numbers::from(NUMBERS);
        let homography = chart().homography(&numbers);
        let back = chart().numbers(&homography).unwrap();
        assert!((back - numbers).amax() < 1e-9, "{back}");
        let point = [-20.0, 15.0];
        let (image, _) = chart().project(&numbers, point);
        let same = homography.apply(point);
        assert!((image[0] - same[0]).hypot(image[1] - same[1]) < 1e-9);
    }

    #[test]
    fn the_derivatives_are_those_of_small_steps() {
        let numbers = Numbers::from(NUMBERS);
        let point = [-20.0, 15.0];
        let (_, slope) = chart().project(&numbers, point);
        for column in 0..M {
            let mut moved = numbers;
            moved[column] += 1e-6;
            let (there, _) = chart().project(&moved, point);
            let (here, _) = chart().project(&numbers, point);
            for row in 0..2 {
                let step = (there[row] - here[row]) / 1e-6;
                assert!((step - slope[(row, column)]).abs() < 1e-3 * (1.0 + step.abs()));
            }
        }
    }

    #[test]
    fn a_camera_that_moves_and_turns_over_the_plane_keeps_its_shape() {
        // A pinhole, tilted once and for all, over the plane z = 0; it is turned about z.
        let look = |turn: f64, x: f64, y: f64, z: f64| {
            let tilt = nalgebra::Rotation3::from_euler_angles(0.12, -0.08, 0.02);
            let wrist = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), turn);
            let turned = tilt * wrist;
            let m = turned.matrix();
            let shift = m * nalgebra::Vector3::new(-x, -y, z);
            let view = Matrix3::from_columns(&[m.column(0).into(), m.column(1).into(), shift]);
            let pinhole = Matrix3::new(432.0, 0.0, 173.0, 0.0, 432.0, 130.0, 0.0, 0.0, 1.0);
            chart().numbers(&Homography::from_matrix(pinhole * view)).unwrap()
        };
        let (here, there) = (look(0.0, 3.0, 5.0, 220.0), look(1.9, -20.0, 9.0, 180.0));
        assert!((here.rows(4, 4) - there.rows(4, 4)).amax() < 1e-9, "{here} {there}");
        assert!((here - there).rows(0, 4).amin() > 1.0);
    }
}
