//! The arm's part of a rig description.

use super::fields::{DescriptionFields, POSITIVE};
use super::{JointLimits, Kinematics, Pose, SpeedLimits, Workspace};
use evrig_core::units::{Hertz, Millimetres};
use std::convert::Infallible;
use std::str::FromStr;

/// Connection of the arm.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ArmPort {
    /// The simulated arm of this program.
    Sim,
    /// The port at which a Magician answers.
    Auto,
    /// This serial port.
    Path(String),
}

/// The arm as the rig file states it.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmDescription {
    /// Connection.
    pub port: ArmPort,
    /// Where it goes to be homed and parked.
    pub home: Pose,
    /// Its lengths, tool included.
    pub kinematics: Kinematics,
    /// Where the tool may be.
    pub workspace: Workspace,
    /// What the joints may do.
    pub joints: JointLimits,
    /// What the tool may do.
    pub speed: SpeedLimits,
    /// How often its pose is asked for during a recording.
    pub pose_rate: Hertz,
}

impl FromStr for ArmPort {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "sim" => Self::Sim,
            "auto" => Self::Auto,
            path => Self::Path(path.to_owned()),
        })
    }
}

/// Beyond the reach of any desktop arm: a value outside is a mistake of the unit.
const POSITION_RANGE_MM: std::ops::RangeInclusive<f64> = -2000.0..=2000.0;
const ANGLE_RANGE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;

impl Pose {
    pub(crate) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let [x, y, z] = ["x_mm", "y_mm", "z_mm"].map(|key| fields.number(key, POSITION_RANGE_MM));
        Self::from_mm_deg([x, y, z, fields.number("r_deg", ANGLE_RANGE_DEG)])
    }
}

impl ArmDescription {
    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let length = |key| fields.optional_number(key, 1.0..=1000.0).map(Millimetres);
        let tool_offset = fields.numbers("tool_offset_mm", -300.0..=300.0).map(Millimetres);
        let magician = Kinematics::magician(tool_offset);
        fields.require("port");
        Self {
            port: fields.parsed("port").unwrap_or(ArmPort::Sim),
            home: fields.table("home", Pose::read),
            kinematics: Kinematics {
                rear_arm: length("rear_arm_mm").unwrap_or(magician.rear_arm),
                forearm: length("forearm_mm").unwrap_or(magician.forearm),
                tool_offset,
            },
            workspace: fields.table("workspace", Workspace::read),
            joints: fields.table("joints", JointLimits::read),
            speed: fields.table("speed", SpeedLimits::read),
            pose_rate: Hertz(fields.optional_number("pose_rate_hz", 1.0..=250.0).unwrap_or(20.0)),
        }
    }
}

impl ArmDescription {
    /// The arm is parked at home, so home must be where it may be.
    pub(super) fn check_home(&self, fields: &DescriptionFields<'_, '_>) {
        let (gauges, _) = self.gauge_pose(self.home);
        for gauge in gauges.iter().filter(|gauge| gauge.is_exceeded() && gauge.value.is_finite()) {
            fields.complain_about("home", gauge);
        }
    }
}

impl Workspace {
    fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        Self {
            radius_mm: fields.interval("radius_mm", 0.0..=2000.0),
            x_mm: fields.optional_interval("x_mm", POSITION_RANGE_MM),
            y_mm: fields.optional_interval("y_mm", POSITION_RANGE_MM),
            z_mm: fields.interval("z_mm", POSITION_RANGE_MM),
        }
    }
}

impl JointLimits {
    fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        Self {
            j1_deg: fields.interval("j1_deg", ANGLE_RANGE_DEG),
            j2_deg: fields.interval("j2_deg", ANGLE_RANGE_DEG),
            j3_deg: fields.interval("j3_deg", ANGLE_RANGE_DEG),
            j4_deg: fields.interval("j4_deg", ANGLE_RANGE_DEG),
            elbow_deg: fields.optional_interval("elbow_deg", 0.0..=180.0),
            j3_rises_above_j2_deg: fields.optional_number("j3_rises_above_j2_deg", ANGLE_RANGE_DEG),
            speed_deg_per_s: fields.numbers("speed_deg_per_s", POSITIVE),
        }
    }
}

impl SpeedLimits {
    fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        Self {
            speed_mm_per_s: fields.number("speed_mm_per_s", POSITIVE),
            acceleration_mm_per_s2: fields.number("acceleration_mm_per_s2", POSITIVE),
            curve_acceleration_mm_per_s2: fields
                .optional_number("curve_acceleration_mm_per_s2", POSITIVE),
            turn_speed_deg_per_s: fields.number("turn_speed_deg_per_s", POSITIVE),
            turn_acceleration_deg_per_s2: fields.number("turn_acceleration_deg_per_s2", POSITIVE),
        }
    }
}
