//! Mounting of the cameras on the tool.

use super::Pose;
use super::fields::DescriptionFields;
use evrig_core::units::{Degrees, Millimetres};
use nalgebra::{Rotation3, Unit, Vector3};

/// A camera's place in the tool frame.
///
/// The tool frame's origin is the tool point, z is up, and it turns with the
/// wrist: at r = 0 its axes are the base's. With no rotation the top of the
/// image points upwards; where the camera points straight up or down, it
/// points along the tool's x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounting {
    /// Optical centre in the tool frame.
    pub position: [Millimetres; 3],
    /// Optical axis towards the scene, in the tool frame, length one.
    pub axis: [f64; 3],
    /// Roll of the camera about its axis, clockwise as seen from behind it.
    pub rotation: Degrees,
}

/// The cameras on the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// The event camera.
    pub davis: Mounting,
    /// The frame camera.
    pub pi: Mounting,
}

/// A camera in the base frame at one pose of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraFrame {
    /// Optical centre, millimetres.
    pub centre_mm: Vector3<f64>,
    /// Towards higher columns of the image, length one.
    pub right: Vector3<f64>,
    /// Towards higher rows of the image, length one.
    pub down: Vector3<f64>,
    /// Along the optical axis towards the scene, length one.
    pub forward: Vector3<f64>,
}

impl Mounting {
    /// The camera in the base frame when the tool is at `tool`.
    #[must_use]
    pub fn frame(&self, tool: Pose) -> CameraFrame {
        let base_from_tool = Rotation3::from_axis_angle(&Vector3::z_axis(), tool.r.0.to_radians());
        let forward = Unit::new_normalize(Vector3::from(self.axis));
        let is_vertical = forward.x.hypot(forward.y) < 1e-3;
        let upwards = if is_vertical { Vector3::x() } else { Vector3::z() };
        let right = forward.cross(&upwards).normalize();
        let roll = Rotation3::from_axis_angle(&forward, self.rotation.0.to_radians());
        let right = roll * right;
        let down = forward.cross(&right);
        let centre = Vector3::from(self.position.map(Millimetres::value));
        CameraFrame {
            centre_mm: Vector3::from(tool.position_mm()) + base_from_tool * centre,
            right: base_from_tool * right,
            down: base_from_tool * down,
            forward: base_from_tool * forward.into_inner(),
        }
    }

    fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let axis = fields.numbers("axis", -1.0..=1.0);
        let length = Vector3::from(axis).norm();
        if length < 1e-6 {
            fields.complain_about("axis", "the optical axis has no direction");
        }
        Self {
            position: fields.numbers("position_mm", -500.0..=500.0).map(Millimetres),
            axis: axis.map(|part| part / length),
            rotation: Degrees(fields.number("rotation_deg", -360.0..=360.0)),
        }
    }
}

impl Mount {
    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        Self {
            davis: fields.table("davis", Mounting::read),
            pi: fields.table("pi", Mounting::read),
        }
    }
}

impl CameraFrame {
    /// A point of the base frame in camera coordinates: right, down, forward of its centre,
    /// millimetres.
    #[must_use]
    pub fn to_camera(&self, point_mm: Vector3<f64>) -> [f64; 3] {
        let from_centre = point_mm - self.centre_mm;
        [self.right, self.down, self.forward].map(|axis| axis.dot(&from_centre))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mounting(axis: [f64; 3], rotation: f64) -> Mounting {
        Mounting { position: [10.0, 0.0, -5.0].map(Millimetres), axis, rotation: Degrees(rotation) }
    }

    fn near(a: Vector3<f64>, b: [f64; 3]) -> bool {
        (a - Vector3::from(b)).norm() < 1e-12
    }

    #[test]
    fn a_camera_that_looks_down_has_its_top_along_the_tools_x() {
        let camera = mounting([0.0, 0.0, -1.0], 0.0);
        let frame = camera.frame(Pose::from_mm_deg([240.0, 0.0, 100.0, 90.0]));
        assert!(near(frame.down, [0.0, -1.0, 0.0]) && near(frame.right, [1.0, 0.0, 0.0]));
        assert!(near(frame.centre_mm, [240.0, 10.0, 95.0]));
    }

    #[test]
    fn a_camera_that_looks_ahead_is_upright_until_it_is_rolled() {
        let tool = Pose::default();
        let ahead = mounting([1.0, 0.0, 0.0], 0.0).frame(tool);
        assert!(near(ahead.down, [0.0, 0.0, -1.0]) && near(ahead.right, [0.0, -1.0, 0.0]));
        let rolled = mounting([1.0, 0.0, 0.0], 90.0).frame(tool);
        assert!(near(rolled.right, [0.0, 0.0, -1.0]), "its right side sinks: {}", rolled.right);
    }

    #[test]
    fn a_frame_is_right_handed_and_a_point_ahead_is_ahead() {
        let frame =
            mounting([0.3, -0.2, -0.7], 33.0).frame(Pose::from_mm_deg([1.0, 2.0, 3.0, 20.0]));
        assert!(near(frame.right.cross(&frame.down), frame.forward.into()));
        let [right, down, forward] = frame.to_camera(frame.centre_mm + 100.0 * frame.forward);
        assert!(right.abs() < 1e-9 && down.abs() < 1e-9 && (forward - 100.0).abs() < 1e-9);
    }
}
