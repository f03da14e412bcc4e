//! The geometry of the head: where the print lies in each camera at a pose of the head.

use crate::roi::Lens;
use evrig_session::rig::{Mount, Pose};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// Degrees of freedom of the arm's hand: three of place and the turn of the wrist.
pub(super) const POSE: usize = 4;

/// Where the head is over the print: x and y of the Pi camera's optical centre along the head's own
/// axes at turn zero, its distance from the print's origin along them, millimetres, and the turn
/// of the wrist, radians.
pub(super) type HeadPose = [f64; POSE];

/// What does not change while the head moves: how the print lies to it, and what it turns about.
///
/// The head's axes are those of the Pi camera: right, down, forward.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Head {
    /// Turn of the print about the Pi's optical axis when the wrist's turn is zero, radians.
    pub roll_rad: f64,
    /// Tilt of the print about the Pi's right and down axes, radians.
    pub tilt_rad: [f64; 2],
    /// The axis of the wrist in the Pi camera's axes, length one.
    pub axis: [f64; 3],
    /// How much that axis is tilted against what the rig states, about right and down, radians.
    pub axis_tilt_rad: [f64; 2],
}

/// Constants of the head that can be fitted: both tilts.
pub(super) const HEAD: usize = 4;

/// How the event camera sits beside the Pi camera, and its lens.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DavisMount {
    /// Stated turn from the Pi's axes to the DAVIS's, row by row.
    pub stated_turn: [[f64; 3]; 3],
    /// Turn on top of the stated one: a rotation vector in the DAVIS's axes, radians.
    pub turn_rad: [f64; 3],
    /// Optical centre of the DAVIS in the Pi's axes, millimetres.
    pub offset_mm: [f64; 3],
    /// The lens as the rig states it.
    pub lens: Lens,
    /// Logarithm of the true focal length over the stated one.
    pub ln_focal: f64,
    /// Radial distortion on top of the stated lens: a ray is longer by this times its square.
    pub radial: f64,
}

/// Constants of the mount that act on the matrix: turn and offset.
pub(super) const MOUNT: usize = 6;

impl Head {
    /// The head of a rig whose print is square to the Pi camera.
    #[must_use]
    pub fn stated(mount: &Mount) -> Self {
        let frame = mount.pi.frame(Pose::default());
        let wrist = Vector3::z();
        let axis = [frame.right, frame.down, frame.forward].map(|own| own.dot(&wrist));
        Self { roll_rad: 0.0, tilt_rad: [0.0; 2], axis, axis_tilt_rad: [0.0; 2] }
    }

    /// From millimetres on the print to rays of the Pi camera, homogeneous.
    pub(super) fn pi_from_plane(&self, pose: &HeadPose) -> Matrix3<f64> {
        let [x, y, distance, turn] = *pose;
        let tilt = |[a, b]: [f64; 2]| Rotation3::new(Vector3::new(a, b, 0.0));
        let print =
            tilt(self.tilt_rad) * Rotation3::from_axis_angle(&Vector3::z_axis(), self.roll_rad);
        let axis = tilt(self.axis_tilt_rad) * Vector3::from(self.axis);
        let back = Rotation3::new(axis * -turn);
        let to_print = back * Vector3::new(-x, -y, distance);
        let axes = (back * print).into_inner();
        Matrix3::from_columns(&[axes.column(0).into(), axes.column(1).into(), to_print])
    }

    /// From rays of the Pi camera to millimetres on the print; None where the view is edge-on.
    pub(super) fn plane_from_pi(&self, pose: &HeadPose) -> Option<Matrix3<f64>> {
        self.pi_from_plane(pose).try_inverse()
    }

    /// The same head with its constants changed.
    pub(super) fn moved(&self, by: &[f64; HEAD]) -> Self {
        let [a, b, c, d] = *by;
        Self {
            tilt_rad: [self.tilt_rad[0] + a, self.tilt_rad[1] + b],
            axis_tilt_rad: [self.axis_tilt_rad[0] + c, self.axis_tilt_rad[1] + d],
            ..*self
        }
    }
}

impl DavisMount {
    /// The mount as a rig states it.
    #[must_use]
    pub fn stated(mount: &Mount, lens: Lens) -> Self {
        let (pi, davis) = (mount.pi.frame(Pose::default()), mount.davis.frame(Pose::default()));
        let rows = |of: &evrig_session::rig::CameraFrame| {
            Matrix3::from_rows(&[of.right.transpose(), of.down.transpose(), of.forward.transpose()])
        };
        let offset = rows(&pi) * (davis.centre_mm - pi.centre_mm);
        let turn = rows(&davis) * rows(&pi).transpose();
        Self {
            stated_turn: std::array::from_fn(|i| std::array::from_fn(|j| turn[(i, j)])),
            turn_rad: [0.0; 3],
            offset_mm: offset.into(),
            lens,
            ln_focal: 0.0,
            radial: 0.0,
        }
    }

    /// From millimetres on the print to rays of the DAVIS, given those of the Pi.
    pub(super) fn davis_from_plane(&self, pi_from_plane: &Matrix3<f64>) -> Matrix3<f64> {
        let stated = Matrix3::from_fn(|i, j| self.stated_turn[i][j]);
        let turn = Rotation3::new(Vector3::from(self.turn_rad)).into_inner() * stated;
        let mut moved = *pi_from_plane;
        let third = moved.column(2) - Vector3::from(self.offset_mm);
        moved.set_column(2, &third);
        turn * moved
    }

    /// The ray through a sensor place; None where the stated distortion has no inverse.
    pub(super) fn ray(&self, place: [f64; 2]) -> Option<[f64; 2]> {
        let [u, v] = stated_ray(&self.lens, place)?;
        let longer = (1.0 + self.radial * (u * u + v * v)) / self.ln_focal.exp();
        Some([u * longer, v * longer])
    }

    /// Where a ray meets the sensor.
    pub(super) fn place(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [a, b] = [u, v].map(|part| part * self.ln_focal.exp());
        let mut stated = [a, b];
        // The correction is small: a few rounds leave nothing.
        for _ in 0..6 {
            let longer = 1.0 + self.radial * (stated[0].powi(2) + stated[1].powi(2));
            stated = [a / longer, b / longer];
        }
        let [cx, cy] = self.lens.centre_px;
        self.lens
            .distort([cx + self.lens.focal_px * stated[0], cy + self.lens.focal_px * stated[1]])
    }

    /// The same mount, turn and offset changed.
    pub(super) fn moved(&self, by: &[f64; MOUNT]) -> Self {
        Self {
            turn_rad: std::array::from_fn(|i| self.turn_rad[i] + by[i]),
            offset_mm: std::array::from_fn(|i| self.offset_mm[i] + by[3 + i]),
            ..*self
        }
    }
}

/// The ray through a place of a lens: right and down over forward.
pub(super) fn stated_ray(lens: &Lens, place: [f64; 2]) -> Option<[f64; 2]> {
    let [x, y] = lens.undistort(place)?;
    let [cx, cy] = lens.centre_px;
    Some([(x - cx) / lens.focal_px, (y - cy) / lens.focal_px])
}

/// Where a ray meets the sensor behind a lens.
pub(super) fn stated_place(lens: &Lens, [u, v]: [f64; 2]) -> [f64; 2] {
    let [cx, cy] = lens.centre_px;
    lens.distort([cx + lens.focal_px * u, cy + lens.focal_px * v])
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_session::rig::Rig;

    #[test]
    fn the_stated_mount_puts_the_same_place_where_the_rig_does() {
        let rig = Rig::simulated().unwrap();
        let head = Head::stated(&rig.mount);
        let mount = DavisMount::stated(&rig.mount, Lens::of(&rig.davis.camera));
        // The tool at two poses; the print square below, its origin at a known base point.
        for tool in [[270.0, 0.0, 100.0, 90.0], [262.0, 3.0, 101.0, 72.0]] {
            let tool = Pose::from_mm_deg(tool);
            let origin = Vector3::new(270.0, 0.0, -138.0);
            let (pi, davis) = (rig.mount.pi.frame(tool), rig.mount.davis.frame(tool));
            let at_zero = rig.mount.pi.frame(Pose::from_mm_deg([270.0, 0.0, 100.0, 90.0]));
            // Head axes at turn zero: those of the pose with r = 90.
            let turn = (tool.r.0 - 90.0).to_radians();
            let c = pi.centre_mm - origin;
            let pose =
                [at_zero.right.dot(&c), at_zero.down.dot(&c), -at_zero.forward.dot(&c), turn];
            let place_mm = [11.0, -7.0];
            let point = origin + at_zero.right * place_mm[0] + at_zero.down * place_mm[1];
            let matrix = head.pi_from_plane(&pose);
            let ray = |m: Matrix3<f64>| {
                let q = m * Vector3::new(place_mm[0], place_mm[1], 1.0);
                [q.x / q.z, q.y / q.z]
            };
            let [right, down, forward] = pi.to_camera(point);
            let got = ray(matrix);
            assert!((got[0] - right / forward).abs() < 1e-12);
            assert!((got[1] - down / forward).abs() < 1e-12);
            let [right, down, forward] = davis.to_camera(point);
            let got = ray(mount.davis_from_plane(&matrix));
            assert!((got[0] - right / forward).abs() < 1e-12, "{got:?}");
            assert!((got[1] - down / forward).abs() < 1e-12, "{got:?}");
        }
    }

    #[test]
    fn places_and_rays_of_the_davis_undo_each_other() {
        let rig = Rig::simulated().unwrap();
        let mut mount = DavisMount::stated(&rig.mount, Lens::of(&rig.davis.camera));
        (mount.ln_focal, mount.radial) = (0.01, -0.03);
        for place in [[3.0, 250.0], [173.0, 130.0], [300.5, 20.5]] {
            let back = mount.place(mount.ray(place).unwrap());
            assert!((back[0] - place[0]).hypot(back[1] - place[1]) < 1e-6);
        }
    }
}
