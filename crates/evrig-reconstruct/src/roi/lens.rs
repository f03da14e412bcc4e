//! Lens model: sensor pixels to ideal pinhole pixels and back.

use evrig_session::rig::CameraDescription;
use kornia_imgproc::calibration::CameraIntrinsic;
use kornia_imgproc::calibration::distortion::{
    PolynomialDistortion, TermCriteria, distort_point_polynomial, undistort_normalized_point_iter,
};
use nalgebra::Matrix2;
use serde::{Deserialize, Serialize};

/// Pinhole camera with Brown's distortion, as in the rig description.
///
/// Pixel coordinates are continuous: pixel `i` covers `i..i + 1`. *Ideal* pixels are those of the
/// same camera without distortion; homographies hold only there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// Focal length in pixels.
    pub focal_px: f64,
    /// Principal point.
    pub centre_px: [f64; 2],
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

impl Lens {
    /// The lens of a camera.
    #[must_use]
    pub fn of(camera: &CameraDescription) -> Self {
        Self {
            focal_px: camera.focal_length.0 / (camera.pixel_pitch.0 * 1e-3),
            centre_px: camera.centre_px,
            distortion: camera.distortion,
        }
    }

    /// The ideal pixel of a sensor pixel; None where the distortion has no inverse.
    #[must_use]
    pub fn undistort(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        if self.distortion == [0.0; 5] {
            return Some([u, v]);
        }
        let [cx, cy] = self.centre_px;
        let [x, y] = [(u - cx) / self.focal_px, (v - cy) / self.focal_px];
        let criteria = TermCriteria { max_iter: 60, eps: 1e-9 };
        let brown = self.brown();
        let found = undistort_normalized_point_iter(x, y, u, v, &self.pinhole(), &brown, criteria);
        let ideal = [cx + self.focal_px * found.x, cy + self.focal_px * found.y];
        let back = self.distort(ideal);
        // A thousandth of a pixel suffices, whatever the solver reports.
        ((back[0] - u).hypot(back[1] - v) < 1e-3).then_some(ideal)
    }

    /// The sensor pixel of an ideal pixel.
    #[must_use]
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (u, v) = distort_point_polynomial(x, y, &self.pinhole(), &self.brown());
        [u, v]
    }

    /// Derivative of the ideal pixel by the sensor pixel.
    pub(super) fn undistort_jacobian(&self, sensor: [f64; 2]) -> Option<Matrix2<f64>> {
        if self.distortion == [0.0; 5] {
            return Some(Matrix2::identity());
        }
        let step = 0.25;
        let [u, v] = sensor;
        let [left, right] = [self.undistort([u - step, v])?, self.undistort([u + step, v])?];
        let [above, below] = [self.undistort([u, v - step])?, self.undistort([u, v + step])?];
        let slope = |a: f64, b: f64| (b - a) / (2.0 * step);
        Some(Matrix2::new(
            slope(left[0], right[0]),
            slope(above[0], below[0]),
            slope(left[1], right[1]),
            slope(above[1], below[1]),
        ))
    }

    fn pinhole(&self) -> CameraIntrinsic {
        let [cx, cy] = self.centre_px;
        CameraIntrinsic { fx: self.focal_px, fy: self.focal_px, cx, cy }
    }

    fn brown(&self) -> PolynomialDistortion {
        let [k1, k2, p1, p2, k3] = self.distortion;
        PolynomialDistortion { k1, k2, k3, p1, p2, ..PolynomialDistortion::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_pixel_comes_back_straight() {
        let lens = Lens {
            focal_px: 430.0,
            centre_px: [173.0, 130.0],
            distortion: [-0.25, 0.08, 0.001, -0.0005, 0.01],
        };
        for pixel in [[2.0, 3.0], [173.0, 130.0], [340.0, 20.0], [100.0, 250.0]] {
            let ideal = lens.undistort(pixel).unwrap();
            let back = lens.distort(ideal);
            assert!((back[0] - pixel[0]).hypot(back[1] - pixel[1]) < 1e-4, "{pixel:?} {back:?}");
        }
        let corner = lens.undistort([2.0, 3.0]).unwrap();
        assert!(corner[0] < -2.0, "a barrel lens draws the corner in: {corner:?}");
        let slope = lens.undistort_jacobian([173.0, 130.0]).unwrap();
        assert!((slope - Matrix2::identity()).norm() < 0.01);
    }
}
