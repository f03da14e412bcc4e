//! Kinematics of the simulated arm: the parallelogram of a Magician.
//!
//! Kept apart from the kinematics the path checker uses, so that each can be
//! held against the other.

use evrig_device::dobot::alarm::Alarm;

/// Length of the rear arm, mm.
const REAR: f64 = 135.0;
/// Length of the forearm, mm.
const FORE: f64 = 147.0;

/// Limits of the simulated joints. Sources disagree; these are the widest
/// of the user guides, with the parallelogram's limit of the vendor's virtual arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedJointLimits {
    /// Lower and upper limit of base, rear arm, forearm, end, degrees.
    pub joints_deg: [(f64, f64); 4],
    /// Lower and upper limit of the angle between the arms, 90 + J2 - J3, degrees.
    pub between_arms_deg: (f64, f64),
}

impl Default for SimulatedJointLimits {
    fn default() -> Self {
        Self {
            joints_deg: [(-125.0, 125.0), (-5.0, 90.0), (-15.0, 90.0), (-150.0, 150.0)],
            between_arms_deg: (20.0, 145.0),
        }
    }
}

impl SimulatedJointLimits {
    /// Whether the joint angles are within their limits.
    #[must_use]
    pub(super) fn allow(&self, joints: [f64; 4]) -> bool {
        let within = |value: f64, (low, high): (f64, f64)| (low..=high).contains(&value);
        let [_, rear, fore, _] = joints;
        self.joints_deg.iter().zip(joints).all(|(range, joint)| within(joint, *range))
            && within(90.0 + rear - fore, self.between_arms_deg)
    }
}

/// Tool position x, y, z (mm) and r (deg) of the joints (deg), with the tool `bias` mm
/// away from the flange.
#[must_use]
pub(super) fn forward(joints: [f64; 4], bias: [f64; 3]) -> [f64; 4] {
    let [base, rear, fore, end] = joints.map(f64::to_radians);
    let reach = REAR * rear.sin() + FORE * fore.cos() + bias[0];
    [
        reach * base.cos() - bias[1] * base.sin(),
        reach * base.sin() + bias[1] * base.cos(),
        REAR * rear.cos() - FORE * fore.sin() + bias[2],
        (base + end).to_degrees(),
    ]
}

/// Joints (deg) that bring the tool to x, y, z (mm), r (deg).
///
/// # Errors
/// The alarm the arm raises when the place is on the base axis or out of reach.
pub(super) fn inverse(xyzr: [f64; 4], bias: [f64; 3]) -> Result<[f64; 4], Alarm> {
    let [x, y, z, r] = xyzr;
    if xyzr.iter().any(|value| !value.is_finite()) {
        return Err(Alarm::PLAN_OUT_OF_REACH);
    }
    let outwards_squared = x * x + y * y - bias[1] * bias[1];
    if outwards_squared <= 1e-9 {
        return Err(Alarm::PLAN_SINGULARITY);
    }
    let outwards = outwards_squared.sqrt();
    let base = y.atan2(x) - bias[1].atan2(outwards);
    let across = outwards - bias[0];
    let up = z - bias[2];
    let squared = across * across + up * up;
    let distance = squared.sqrt();
    let cosine = (REAR * REAR + squared - FORE * FORE) / (2.0 * REAR * distance);
    if !(-1.0..=1.0).contains(&cosine) {
        return Err(Alarm::PLAN_OUT_OF_REACH);
    }
    let elevation = cosine.acos() + up.atan2(across);
    let fore = (REAR * elevation.sin() - up).atan2(across - REAR * elevation.cos());
    Ok([base.to_degrees(), 90.0 - elevation.to_degrees(), fore.to_degrees(), r - base.to_degrees()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_tool_is_where_a_real_arm_reported_it() {
        // A user's log of a real arm with the laser (bias 70 mm), pydobot issue 36.
        let xyzr = forward([86.717_674_3, 14.331_169_1, 59.563_831_3, 0.0], [70.0, 0.0, 0.0]);
        for (found, reported) in xyzr.iter().zip([10.184_884, 177.591_187, 4.056_442, 86.717_674]) {
            assert!((found - reported).abs() < 2e-4, "{xyzr:?}");
        }
    }

    #[test]
    fn the_factory_home_is_where_users_record_it() {
        let xyzr = forward([0.0, 45.0, 45.0, 0.0], [59.7, 0.0, 0.0]);
        assert!((xyzr[0] - 259.1).abs() < 0.1 && (xyzr[2] + 8.5).abs() < 0.1, "{xyzr:?}");
    }

    #[test]
    fn a_place_beyond_the_arms_is_out_of_reach() {
        assert_eq!(inverse([500.0, 0.0, 0.0, 0.0], [0.0; 3]), Err(Alarm::PLAN_OUT_OF_REACH));
        assert_eq!(inverse([0.0, 0.0, 100.0, 0.0], [0.0; 3]), Err(Alarm::PLAN_SINGULARITY));
        assert_eq!(inverse([f64::NAN; 4], [0.0; 3]), Err(Alarm::PLAN_OUT_OF_REACH));
    }

    proptest! {
        #[test]
        fn the_checkers_own_kinematics_say_the_same(
            base in -120.0..120.0_f64, rear in 0.0..85.0_f64, fore in -10.0..85.0_f64,
            end in -90.0..90.0_f64, bx in 0.0..80.0_f64, by in -20.0..20.0_f64,
        ) {
            use evrig_session::rig::{Joints, Kinematics};
            use evrig_core::units::Millimetres;
            let bias = [bx, by, 3.0];
            let other = Kinematics::magician(bias.map(Millimetres));
            let joints = [base, rear, fore, end];
            let here = forward(joints, bias);
            let there = other.forward(Joints::from_deg(joints)).to_mm_deg();
            prop_assert!(here.iter().zip(there).all(|(a, b)| (a - b).abs() < 1e-9));
        }

        #[test]
        fn joints_come_back_from_where_they_bring_the_tool(
            base in -120.0..120.0_f64, rear in 0.0..85.0_f64, fore in -10.0..85.0_f64,
            end in -90.0..90.0_f64, by in -20.0..20.0_f64,
        ) {
            let bias = [60.0, by, -5.0];
            let joints = [base, rear, fore, end];
            prop_assume!(SimulatedJointLimits::default().allow(joints));
            let xyzr = forward(joints, bias);
            prop_assume!(xyzr[0].hypot(xyzr[1]) > 100.0);
            let back = inverse(xyzr, bias).unwrap();
            for (found, truth) in back.iter().zip(joints) {
                prop_assert!((found - truth).abs() < 1e-6, "{:?} {:?}", back, joints);
            }
        }
    }
}
