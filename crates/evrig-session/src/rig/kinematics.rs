//! The Magician's kinematics: joints to pose, pose to joints, speeds of the one to speeds of the
//! other.
//!
//! J2 is measured from the vertical and J3 from the horizontal, both absolute:
//! a parallelogram keeps the wrist level, so that the tool's height and reach
//! follow from J2 and J3 alone. With tool offset (bx, by, bz):
//!
//! ```text
//! h = 135 sin J2 + 147 cos J3 + bx
//! x = h cos J1 - by sin J1,  y = h sin J1 + by cos J1
//! z = 135 cos J2 - 147 sin J3 + bz,  r = J1 + J4
//! ```
//!
//! Two poses read from real arms confirm it (see the tests); the sign of bz
//! has not been confirmed on hardware.

use super::{Joints, Pose};
use evrig_core::units::Millimetres;
use nalgebra::{Matrix4, Vector4};

/// Lengths of the arm and of what it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kinematics {
    /// Shoulder to elbow; 135 mm on a Magician.
    pub rear_arm: Millimetres,
    /// Elbow to wrist; 147 mm on a Magician.
    pub forearm: Millimetres,
    /// Wrist to tool point `[bx, by, bz]`: outwards, to the left, up; not turned by the wrist.
    pub tool_offset: [Millimetres; 3],
}

/// Why no joint angles give a pose.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unreachable {
    /// Farther from the shoulder than the stretched arm.
    #[error("{by:.1} too far for the stretched arm")]
    TooFar {
        /// What is missing.
        by: Millimetres,
    },
    /// Nearer to the shoulder than the folded arm.
    #[error("{by:.1} too near for the folded arm")]
    TooNear {
        /// What is missing.
        by: Millimetres,
    },
    /// Over the base, where the base's angle is not determined.
    #[error("on the axis of the base, where its angle is not determined")]
    OnAxis,
    /// A coordinate is not a number.
    #[error("a coordinate is not a finite number")]
    NotFinite,
}

impl Kinematics {
    /// A bare Magician that holds a tool at `tool_offset`.
    #[must_use]
    pub const fn magician(tool_offset: [Millimetres; 3]) -> Self {
        Self { rear_arm: Millimetres(135.0), forearm: Millimetres(147.0), tool_offset }
    }

    /// The pose at these joint angles.
    #[must_use]
    pub fn forward(&self, joints: Joints) -> Pose {
        let [bx, by, bz] = self.tool_offset.map(Millimetres::value);
        let [j1, j2, j3, _] = joints.to_deg().map(f64::to_radians);
        let outwards = self.rear_arm.0 * j2.sin() + self.forearm.0 * j3.cos() + bx;
        let z = self.rear_arm.0 * j2.cos() - self.forearm.0 * j3.sin() + bz;
        let x = outwards * j1.cos() - by * j1.sin();
        let y = outwards * j1.sin() + by * j1.cos();
        Pose::from_mm_deg([x, y, z, joints.j1.0 + joints.j4.0])
    }

    /// The joint angles that give the pose, elbow up.
    ///
    /// # Errors
    /// When the arm's geometry does not reach the pose, regardless of joint limits.
    pub fn inverse(&self, pose: Pose) -> Result<Joints, Unreachable> {
        let [bx, by, bz] = self.tool_offset.map(Millimetres::value);
        let [x, y, z, r] = pose.to_mm_deg();
        if ![x, y, z, r].iter().all(|value| value.is_finite()) {
            return Err(Unreachable::NotFinite);
        }
        let outwards_squared = x * x + y * y - by * by;
        if outwards_squared <= 1e-12 {
            return Err(Unreachable::OnAxis);
        }
        let outwards = outwards_squared.sqrt();
        let j1 = y.atan2(x) - by.atan2(outwards);
        let (along, up) = (outwards - bx, z - bz);
        let (rear, fore) = (self.rear_arm.0, self.forearm.0);
        let reach = along.hypot(up);
        if reach > rear + fore {
            return Err(Unreachable::TooFar { by: Millimetres(reach - rear - fore) });
        }
        if reach < (rear - fore).abs() {
            return Err(Unreachable::TooNear { by: Millimetres((rear - fore).abs() - reach) });
        }
        let at_shoulder =
            (rear * rear + reach * reach - fore * fore) / (2.0 * rear * reach.max(1e-9));
        let lift = at_shoulder.clamp(-1.0, 1.0).acos() + up.atan2(along);
        let j3 = (rear * lift.sin() - up).atan2(along - rear * lift.cos());
        let j1 = wrapped(j1.to_degrees());
        let j2 = 90.0 - lift.to_degrees();
        Ok(Joints::from_deg([j1, j2, j3.to_degrees(), wrapped(r - j1)]))
    }

    /// Joint speeds in deg/s for a tool speed of `[mm/s, mm/s, mm/s, deg/s]`.
    ///
    /// None where the arm is stretched, folded or over its base: there some
    /// speeds of the tool need boundless speeds of a joint.
    #[must_use]
    pub fn joint_speeds(&self, joints: Joints, tool_speed: [f64; 4]) -> Option<[f64; 4]> {
        let speeds = self.jacobian(joints).lu().solve(&Vector4::from(tool_speed))?;
        // A sine below 1e-6 is a stretched arm to the last digit a pose message carries.
        let bend = (joints.j2.0 - joints.j3.0).to_radians().cos();
        (bend.abs() > 1e-6 && speeds.iter().all(|speed| speed.is_finite())).then(|| speeds.into())
    }

    /// Change of `[x, y, z, r]` (mm, deg) with each joint angle (deg), one column a joint.
    fn jacobian(&self, joints: Joints) -> Matrix4<f64> {
        let [bx, by, _] = self.tool_offset.map(Millimetres::value);
        let [j1, j2, j3, _] = joints.to_deg().map(f64::to_radians);
        let (rear, fore) = (self.rear_arm.0, self.forearm.0);
        let outwards = rear * j2.sin() + fore * j3.cos() + bx;
        let (sin, cos) = j1.sin_cos();
        let degree = 1f64.to_radians();
        let base = [-outwards * sin - by * cos, outwards * cos - by * sin];
        let (rear_out, rear_up) = (rear * j2.cos(), -rear * j2.sin());
        let (fore_out, fore_up) = (-fore * j3.sin(), -fore * j3.cos());
        #[rustfmt::skip]
        let jacobian = Matrix4::new(
            base[0] * degree, rear_out * cos * degree, fore_out * cos * degree, 0.0,
            base[1] * degree, rear_out * sin * degree, fore_out * sin * degree, 0.0,
            0.0,              rear_up * degree,        fore_up * degree,        0.0,
            1.0,              0.0,                     0.0,                     1.0,
        );
        jacobian
    }
}

/// The same direction as an angle within -180..=180 degrees.
fn wrapped(degrees: f64) -> f64 {
    let turned = (degrees + 180.0).rem_euclid(360.0) - 180.0;
    if turned == -180.0 && degrees > 0.0 { 180.0 } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn arm(bx: f64, by: f64, bz: f64) -> Kinematics {
        Kinematics::magician([bx, by, bz].map(Millimetres))
    }

    #[test]
    fn a_pose_logged_by_a_real_arm_is_met_to_the_micrometre() {
        // luismesas/pydobot issue 36: GetPose of a Magician with the laser mounted (bx = 70).
        let joints = Joints::from_deg([86.717_674_3, 14.331_169_1, 59.563_831_3, 0.0]);
        let pose = arm(70.0, 0.0, 0.0).forward(joints).to_mm_deg();
        for (ours, real) in pose.into_iter().zip([10.184_884, 177.591_187, 4.056_442, 86.717_674]) {
            assert!((ours - real).abs() < 1e-4, "{pose:?}");
        }
    }

    #[test]
    fn the_factory_home_is_met_within_the_arms_repeatability() {
        // Users record (259.1198, 0, -8.5687) at the factory home with the suction cup (bx = 59.7).
        let home = arm(59.7, 0.0, 0.0).forward(Joints::from_deg([0.0, 45.0, 45.0, 0.0]));
        assert!(
            home.distance(Pose::from_mm_deg([259.119_8, 0.0, -8.568_7, 0.0])).0 < 0.2,
            "{home}"
        );
    }

    #[test]
    fn on_the_papers_circle_the_wrist_goes_beyond_ninety_degrees() {
        let arm = arm(59.7, 0.0, 0.0);
        let wrists: Vec<f64> = (0..3600)
            .map(|tenth| {
                let angle = (f64::from(tenth) / 10.0).to_radians();
                let (x, y) = (252.0 + 12.0 * angle.cos(), 12.0 * angle.sin());
                arm.inverse(Pose::from_mm_deg([x, y, 100.0, 90.0])).unwrap().j4.0
            })
            .collect();
        let lowest = wrists.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = wrists.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert!((lowest - 87.27).abs() < 0.005 && (highest - 92.73).abs() < 0.005);
    }

    #[test]
    fn what_is_out_of_reach_states_by_how_much() {
        let arm = arm(0.0, 0.0, 0.0);
        let at = |x: f64, z: f64| arm.inverse(Pose::from_mm_deg([x, 0.0, z, 0.0]));
        assert_eq!(at(300.0, 0.0), Err(Unreachable::TooFar { by: Millimetres(18.0) }));
        assert_eq!(at(5.0, 0.0), Err(Unreachable::TooNear { by: Millimetres(7.0) }));
        assert_eq!(at(0.0, 200.0), Err(Unreachable::OnAxis));
        assert_eq!(at(f64::NAN, 0.0), Err(Unreachable::NotFinite));
    }

    #[test]
    fn the_stretched_arm_has_no_joint_speeds() {
        let arm = arm(0.0, 0.0, 0.0);
        let stretched = arm.inverse(Pose::from_mm_deg([282.0, 0.0, 0.0, 0.0])).unwrap();
        assert!(arm.joint_speeds(stretched, [10.0, 0.0, 0.0, 0.0]).is_none());
        let bent = arm.inverse(Pose::from_mm_deg([240.0, 0.0, 0.0, 0.0])).unwrap();
        assert!(arm.joint_speeds(bent, [10.0, 0.0, 0.0, 0.0]).is_some());
    }

    prop_compose! {
        fn anywhere()(
            j1 in -124.0..124.0_f64, j2 in -5.0..90.0_f64, elbow in 5.0..175.0_f64, j4 in -55.0..55.0_f64,
        ) -> Joints {
            // The elbow's inner angle is 90 + J2 - J3.
            Joints::from_deg([j1, j2, 90.0 + j2 - elbow, j4])
        }
    }

    proptest! {
        #[test]
        fn there_and_back_are_the_same_joints(
            joints in anywhere(), bx in 0.0..80.0_f64, by in -20.0..20.0_f64, bz in -60.0..60.0_f64,
        ) {
            let arm = arm(bx, by, bz);
            // Behind its base the arm reaches a point with the base turned round instead.
            let [j1, j2, j3, _] = joints.to_deg().map(f64::to_radians);
            prop_assume!(135.0 * j2.sin() + 147.0 * j3.cos() + bx > 1.0);
            prop_assume!(j1.is_finite());
            let back = arm.inverse(arm.forward(joints)).unwrap();
            for (a, b) in back.to_deg().into_iter().zip(joints.to_deg()) {
                prop_assert!((a - b).abs() < 1e-5, "{back} is not {joints}");
            }
        }

        #[test]
        fn joint_speeds_are_the_change_of_the_joints(
            joints in anywhere(), speed in proptest::array::uniform4(-50.0..50.0_f64),
        ) {
            let arm = arm(59.7, 3.0, -10.0);
            let pose = arm.forward(joints).to_mm_deg();
            prop_assume!(pose[0].hypot(pose[1]) > 50.0);
            let step = |dt: f64| Pose::from_mm_deg(std::array::from_fn(|i| pose[i] + speed[i] * dt));
            let (Ok(before), Ok(after)) = (arm.inverse(step(-1e-5)), arm.inverse(step(1e-5))) else {
                return Ok(());
            };
            let here = arm.inverse(step(0.0)).unwrap();
            let speeds = arm.joint_speeds(here, speed).unwrap();
            let change = (after.to_deg().into_iter().zip(before.to_deg()))
                .map(|(after, before)| (after - before) / 2e-5);
            for (joint, (change, speed)) in change.zip(speeds).enumerate() {
                let bound = 1e-3 * (1.0 + speed.abs());
                prop_assert!((change - speed).abs() < bound, "joint {}", joint + 1);
            }
        }
    }
}
