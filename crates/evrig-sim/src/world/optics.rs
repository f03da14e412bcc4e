//! A camera's geometry: from a pixel to a ray, from a ray to the target.

use evrig_core::geometry::Size;
use evrig_session::rig::{CameraDescription, CameraFrame, Mounting, Pose};
use nalgebra::{Matrix3, Vector3};

/// Where the target lies in the base frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorldPlane {
    /// Middle of image and tag together, millimetres.
    pub(super) centre: Vector3<f64>,
    /// Towards the right of the target.
    pub(super) right: Vector3<f64>,
    /// Towards its bottom.
    pub(super) down: Vector3<f64>,
}

/// A pinhole with Brown's distortion. Pixel coordinates are continuous: pixel `i` covers `i..i +
/// 1`.
#[derive(Debug, Clone, Copy)]
pub(super) struct DistortedPinhole {
    focal_px: f64,
    centre_px: [f64; 2],
    distortion: [f64; 5],
    /// True pixels from those the description means: `centre + turn * (p - centre) + shift`.
    shift_px: [f64; 2],
    turn: [f64; 2],
}

/// A camera on the tool.
#[derive(Debug, Clone, Copy)]
pub(super) struct ToolCamera {
    pub(super) mounting: Mounting,
    pub(super) lens: DistortedPinhole,
    pub(super) size: Size,
}

impl WorldPlane {
    /// From a ray of a camera (right and down over forward) to millimetres on the target,
    /// homogeneous.
    pub(super) fn plane_from_ray(&self, camera: &CameraFrame) -> Matrix3<f64> {
        let axes = Matrix3::from_columns(&[camera.right, camera.down, camera.forward]);
        let normal = self.right.cross(&self.down);
        let to_camera = camera.centre_mm - self.centre;
        let distance = -normal.dot(&to_camera);
        let weight = normal.transpose() * axes;
        let row =
            |axis: Vector3<f64>| weight * axis.dot(&to_camera) + axis.transpose() * axes * distance;
        Matrix3::from_rows(&[row(self.right), row(self.down), weight])
    }
}

impl DistortedPinhole {
    pub(super) fn new(camera: &CameraDescription) -> Self {
        Self {
            focal_px: camera.focal_length.0 / (camera.pixel_pitch.0 * 1e-3),
            centre_px: camera.centre_px,
            distortion: camera.distortion,
            shift_px: [0.0, 0.0],
            turn: [1.0, 0.0],
        }
    }

    /// The same lens, its image moved by a similarity about the image's centre.
    pub(super) fn moved(self, shift_px: [f64; 2], rotation_deg: f64, scale: f64) -> Self {
        let (sin, cos) = rotation_deg.to_radians().sin_cos();
        Self { shift_px, turn: [scale * cos, scale * sin], ..self }
    }

    /// The direction a pixel coordinate looks in: right and down over forward.
    pub(super) fn ray(&self, pixel: [f64; 2]) -> [f64; 2] {
        let [c, s] = self.turn;
        let dx = pixel[0] - self.shift_px[0] - self.centre_px[0];
        let dy = pixel[1] - self.shift_px[1] - self.centre_px[1];
        let square = c * c + s * s;
        let stated = [(c * dx + s * dy) / square, (c * dy - s * dx) / square];
        let distorted = stated.map(|px| px / self.focal_px);
        // Brown's formula has no inverse; it contracts, so iterating its correction converges.
        let mut ray = distorted;
        for _ in 0..30 {
            let bent = self.distort(ray);
            ray = [ray[0] + distorted[0] - bent[0], ray[1] + distorted[1] - bent[1]];
        }
        ray
    }

    /// Where a direction lands, as pixel coordinates.
    pub(super) fn pixel(&self, ray: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.distort(ray).map(|part| part * self.focal_px);
        let [c, s] = self.turn;
        let [cx, cy] = self.centre_px;
        [cx + c * x - s * y + self.shift_px[0], cy + s * x + c * y + self.shift_px[1]]
    }

    fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let square = x * x + y * y;
        let radial = 1.0 + square * (k1 + square * (k2 + square * k3));
        let bend_x = 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x);
        let bend_y = p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y;
        [x * radial + bend_x, y * radial + bend_y]
    }
}

impl ToolCamera {
    /// The rays of all pixels' centres, row-major.
    pub(super) fn rays(&self) -> Vec<[f32; 2]> {
        let (width, height) = (usize::from(self.size.width), usize::from(self.size.height));
        let ray = |i: usize| {
            let centre = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
            self.lens.ray(centre).map(|part| part as f32)
        };
        (0..width * height).map(ray).collect()
    }

    /// From a ray to millimetres on the target when the tool is at `tool`.
    pub(super) fn plane_from_ray(&self, plane: &WorldPlane, tool: Pose) -> Matrix3<f64> {
        plane.plane_from_ray(&self.mounting.frame(tool))
    }

    /// Share of the light that reaches a pixel when the corner loses `corner_loss`.
    pub(super) fn vignette(&self, corner_loss: f64, x: usize, y: usize) -> f64 {
        let half = [f64::from(self.size.width) / 2.0, f64::from(self.size.height) / 2.0];
        let (dx, dy) = (x as f64 + 0.5 - half[0], y as f64 + 0.5 - half[1]);
        1.0 - corner_loss * (dx * dx + dy * dy) / (half[0] * half[0] + half[1] * half[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_session::rig::Rig;

    #[test]
    fn rays_and_pixels_undo_each_other_through_distortion_and_misregistration() {
        let mut description = Rig::simulated().unwrap().davis.camera;
        description.distortion = [-0.2, 0.05, 0.001, -0.002, 0.01];
        let lens = DistortedPinhole::new(&description).moved([1.5, -0.7], 3.0, 1.02);
        for pixel in [[0.0, 0.0], [345.0, 3.0], [173.0, 130.0], [20.5, 259.0]] {
            let back = lens.pixel(lens.ray(pixel));
            assert!((back[0] - pixel[0]).abs() < 1e-6 && (back[1] - pixel[1]).abs() < 1e-6);
        }
    }

    #[test]
    fn the_homography_is_where_the_ray_meets_the_plane() {
        let rig = Rig::simulated().unwrap();
        let tool = Pose::from_mm_deg([250.0, 5.0, 110.0, 80.0]);
        let frame = rig.mount.davis.frame(tool);
        let plane = WorldPlane {
            centre: Vector3::new(260.0, 3.0, -138.0),
            right: Vector3::new(1.0, 0.2, 0.1).normalize(),
            down: Vector3::new(0.2, -1.0, 0.0).normalize(),
        };
        let place = plane.plane_from_ray(&frame) * Vector3::new(0.1, -0.05, 1.0);
        let (x, y) = (place.x / place.z, place.y / place.z);
        let point = plane.centre + x * plane.right + y * plane.down;
        let [right, down, forward] = frame.to_camera(point);
        assert!((right / forward - 0.1).abs() < 1e-9 && (down / forward + 0.05).abs() < 1e-9);
    }
}
