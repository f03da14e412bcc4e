//! Limits of the arm (workspace, joints, speeds) and the margins of poses and motions.

use super::{ArmDescription, Joints, Pose};
use evrig_core::units::{
    DegreesPerSecond, DegreesPerSecond2, MillimetresPerSecond, MillimetresPerSecond2,
};
use serde::Serialize;
use std::fmt;

/// Where the tool point may be, in the base frame, millimetres, lowest and highest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Workspace {
    /// Distance from the base's axis.
    pub radius_mm: [f64; 2],
    /// Forwards.
    pub x_mm: Option<[f64; 2]>,
    /// To the left.
    pub y_mm: Option<[f64; 2]>,
    /// Up from the shoulder.
    pub z_mm: [f64; 2],
}

/// Limits of the joints, degrees, lowest and highest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct JointLimits {
    /// Base.
    pub j1_deg: [f64; 2],
    /// Rear arm.
    pub j2_deg: [f64; 2],
    /// Forearm.
    pub j3_deg: [f64; 2],
    /// Wrist.
    pub j4_deg: [f64; 2],
    /// The elbow's inner angle, 90 + J2 - J3: the parallelogram's own limit.
    pub elbow_deg: Option<[f64; 2]>,
    /// Above this J2 the lowest J3 rises with J2, degree by degree.
    pub j3_rises_above_j2_deg: Option<f64>,
    /// Highest speed of each joint.
    pub speed_deg_per_s: [f64; 4],
}

/// The highest speeds and accelerations of the tool that a trajectory may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedLimits {
    /// Of the tool point.
    pub speed_mm_per_s: f64,
    /// Of the tool point along its path: the ramps, which the firmware limits.
    pub acceleration_mm_per_s2: f64,
    /// Of the tool point across its path, in a curve; the firmware does not check it.
    pub curve_acceleration_mm_per_s2: Option<f64>,
    /// Of the wrist in the base frame.
    pub turn_speed_deg_per_s: f64,
    /// Of the wrist in the base frame.
    pub turn_acceleration_deg_per_s2: f64,
}

/// Rates of the tool in a motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToolRates {
    /// Highest speed of the tool point.
    pub speed: MillimetresPerSecond,
    /// Acceleration along the path.
    pub acceleration: MillimetresPerSecond2,
    /// Acceleration across the path, in its tightest curve.
    pub curve_acceleration: MillimetresPerSecond2,
    /// Highest speed of the wrist in the base frame.
    pub turn_speed: DegreesPerSecond,
    /// Acceleration of the wrist in the base frame.
    pub turn_acceleration: DegreesPerSecond2,
}

/// A quantity with its limits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gauge {
    /// Which limit.
    pub limit: &'static str,
    /// Unit of the numbers.
    pub unit: &'static str,
    /// What it is; infinite at a singularity.
    pub value: f64,
    /// The lowest allowed, where there is one.
    pub low: Option<f64>,
    /// The highest allowed.
    pub high: f64,
}

impl Gauge {
    fn new(limit: &'static str, unit: &'static str, value: f64, [low, high]: [f64; 2]) -> Self {
        Self { limit, unit, value, low: Some(low), high }
    }

    /// A quantity that can only be too much.
    fn up_to(limit: &'static str, unit: &'static str, value: f64, high: f64) -> Self {
        Self { limit, unit, value, low: None, high }
    }

    /// Distance to the nearer limit; negative when it is exceeded.
    #[must_use]
    pub fn margin(&self) -> f64 {
        let above = self.low.map_or(f64::INFINITY, |low| self.value - low);
        // `min` would ignore a NaN, which has no margin.
        if self.value.is_nan() { f64::NEG_INFINITY } else { above.min(self.high - self.value) }
    }

    /// Whether the value is beyond a limit, by more than rounding.
    #[must_use]
    pub fn is_exceeded(&self) -> bool {
        self.margin() < -1e-9 * self.high.abs().max(self.low.unwrap_or(0.0).abs())
    }
}

impl fmt::Display for Gauge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { limit, unit, value, low, high } = self;
        write!(f, "{limit} is {value:.2} {unit}, allowed ")?;
        match low {
            Some(low) => write!(f, "{low} to {high} {unit}")?,
            None => write!(f, "up to {high} {unit}")?,
        }
        if self.is_exceeded() {
            let way = if value > high { "over" } else { "under" };
            write!(f, ", {:.2} {unit} {way}", -self.margin())?;
        }
        Ok(())
    }
}

const JOINTS: [&str; 4] = ["joint J1", "joint J2", "joint J3", "joint J4"];
const JOINT_SPEEDS: [&str; 4] =
    ["speed of joint J1", "speed of joint J2", "speed of joint J3", "speed of joint J4"];

impl ArmDescription {
    /// A pose against reach, workspace and joint limits; without joints where none give the pose.
    #[must_use]
    pub fn gauge_pose(&self, pose: Pose) -> (Vec<Gauge>, Option<Joints>) {
        let [x, y, z, _] = pose.to_mm_deg();
        let space = &self.workspace;
        let mut gauges = vec![
            Gauge::new("reach from the shoulder", "mm", self.reach(pose), self.reach_limits()),
            Gauge::new("workspace radius", "mm", x.hypot(y), space.radius_mm),
            Gauge::new("workspace z", "mm", z, space.z_mm),
        ];
        let optional = [("workspace x", x, space.x_mm), ("workspace y", y, space.y_mm)];
        gauges.extend(
            optional
                .into_iter()
                .filter_map(|(limit, value, range)| Some(Gauge::new(limit, "mm", value, range?))),
        );
        let joints = self.kinematics.inverse(pose).ok();
        if let Some(joints) = joints {
            self.gauge_joints(joints, &mut gauges);
        }
        (gauges, joints)
    }

    fn gauge_joints(&self, joints: Joints, gauges: &mut Vec<Gauge>) {
        let limits = &self.joints;
        let angles = joints.to_deg();
        let mut ranges = [limits.j1_deg, limits.j2_deg, limits.j3_deg, limits.j4_deg];
        if let Some(above) = limits.j3_rises_above_j2_deg {
            ranges[2][0] += (angles[1] - above).max(0.0);
        }
        for ((limit, value), range) in JOINTS.into_iter().zip(angles).zip(ranges) {
            gauges.push(Gauge::new(limit, "deg", value, range));
        }
        if let Some(range) = limits.elbow_deg {
            gauges.push(Gauge::new("elbow angle", "deg", 90.0 + angles[1] - angles[2], range));
        }
    }

    /// A motion through `joints` at a tool speed of `[mm/s, mm/s, mm/s, deg/s]` against the joints'
    /// speeds.
    #[must_use]
    pub fn gauge_joint_speeds(&self, joints: Joints, tool_speed: [f64; 4]) -> [Gauge; 4] {
        let speeds = self.kinematics.joint_speeds(joints, tool_speed);
        std::array::from_fn(|i| {
            let value = speeds.map_or(f64::INFINITY, |speeds| speeds[i].abs());
            Gauge::up_to(JOINT_SPEEDS[i], "deg/s", value, self.joints.speed_deg_per_s[i])
        })
    }

    /// The rates of a motion against the limits; rates of zero are left out.
    #[must_use]
    pub fn gauge_rates(&self, rates: &ToolRates) -> Vec<Gauge> {
        let limits = &self.speed;
        let curve = limits.curve_acceleration_mm_per_s2.unwrap_or(f64::INFINITY);
        [
            ("speed", "mm/s", rates.speed.0, limits.speed_mm_per_s),
            ("acceleration", "mm/s^2", rates.acceleration.0, limits.acceleration_mm_per_s2),
            ("curve acceleration", "mm/s^2", rates.curve_acceleration.0, curve),
            ("turn speed", "deg/s", rates.turn_speed.0, limits.turn_speed_deg_per_s),
            (
                "turn acceleration",
                "deg/s^2",
                rates.turn_acceleration.0,
                limits.turn_acceleration_deg_per_s2,
            ),
        ]
        .into_iter()
        .filter(|(_, _, value, high)| *value > 0.0 && high.is_finite())
        .map(|(limit, unit, value, high)| Gauge::up_to(limit, unit, value, high))
        .collect()
    }

    /// Distance from shoulder to wrist at a pose, in millimetres.
    fn reach(&self, pose: Pose) -> f64 {
        let [bx, by, bz] = self.kinematics.tool_offset.map(|offset| offset.0);
        let [x, y, z, _] = pose.to_mm_deg();
        let outwards = (x * x + y * y - by * by).max(0.0).sqrt();
        (outwards - bx).hypot(z - bz)
    }

    fn reach_limits(&self) -> [f64; 2] {
        let [rear, fore] = [self.kinematics.rear_arm.0, self.kinematics.forearm.0];
        [(rear - fore).abs(), rear + fore]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;
    use proptest::prelude::*;

    fn gauge(gauges: &[Gauge], limit: &str) -> Gauge {
        *gauges.iter().find(|gauge| gauge.limit == limit).unwrap()
    }

    proptest! {
        #[test]
        fn the_elbow_angle_is_that_of_the_triangle_shoulder_elbow_wrist(
            x in 150.0..300.0_f64, y in -100.0..100.0_f64, z in -100.0..120.0_f64,
        ) {
            let arm = Rig::simulated().unwrap().arm;
            let (gauges, joints) = arm.gauge_pose(Pose::from_mm_deg([x, y, z, 0.0]));
            prop_assume!(joints.is_some());
            let reach = gauge(&gauges, "reach from the shoulder").value;
            let cosine = (135.0_f64.powi(2) + 147.0_f64.powi(2) - reach * reach) / (2.0 * 135.0 * 147.0);
            let elbow = gauge(&gauges, "elbow angle").value;
            prop_assert!((elbow - cosine.acos().to_degrees()).abs() < 1e-6, "{elbow}");
        }
    }

    #[test]
    fn the_lowest_forearm_angle_rises_with_the_rear_arm_where_the_rig_states_it() {
        let arm = Rig::find("magician").unwrap().arm;
        let lowest_j3 = |j2: f64| {
            let joints = Joints::from_deg([0.0, j2, 45.0, 0.0]);
            let (gauges, _) = arm.gauge_pose(arm.kinematics.forward(joints));
            gauge(&gauges, "joint J3").low.unwrap()
        };
        assert!((lowest_j3(30.0) + 6.8).abs() < 1e-9);
        assert!((lowest_j3(55.0) - (15.0 - 6.8)).abs() < 1e-6);
    }

    #[test]
    fn a_gauge_states_by_how_much_and_forgives_rounding() {
        let over = Gauge::new("joint J4", "deg", 151.5, [-150.0, 150.0]);
        assert_eq!(
            over.to_string(),
            "joint J4 is 151.50 deg, allowed -150 to 150 deg, 1.50 deg over"
        );
        assert!(over.is_exceeded());
        assert!(!Gauge::new("z", "mm", 160.0 + 1e-12, [0.0, 160.0]).is_exceeded());
        assert!(Gauge::up_to("speed", "deg/s", f64::INFINITY, 320.0).is_exceeded());
        assert!(Gauge::up_to("speed", "deg/s", f64::NAN, 320.0).is_exceeded());
    }
}
