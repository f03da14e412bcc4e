//! The numbers that commands carry, and replies give back.

use super::fields::{Malformed, PayloadFields};

/// x, y, z in millimetres and r in degrees, as on the wire.
pub type XyzR = [f32; 4];

/// Speeds and accelerations of Cartesian moves: mm/s, deg/s, mm/s^2, deg/s^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CartesianLimits {
    /// Speed along the path, mm/s.
    pub xyz_velocity: f32,
    /// Speed of r, deg/s.
    pub r_velocity: f32,
    /// Acceleration along the path, mm/s^2.
    pub xyz_acceleration: f32,
    /// Acceleration of r, deg/s^2.
    pub r_acceleration: f32,
}

/// Percentages of the set speeds and accelerations; above 100 counts as 100.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratios {
    /// Percent of the speed.
    pub velocity: f32,
    /// Percent of the acceleration.
    pub acceleration: f32,
}

/// Limits of continuous-path moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CpLimits {
    /// Largest planned acceleration, mm/s^2.
    pub plan_acceleration: f32,
    /// Largest speed at a junction of two moves, mm/s.
    pub junction_velocity: f32,
    /// Largest actual acceleration, mm/s^2; with `is_real_time` a period instead.
    pub acceleration: f32,
    /// QueuedSteps while commands still arrive, instead of after all were sent.
    pub is_real_time: bool,
}

/// How a point-to-point move goes and how its target is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum PtpMode {
    /// Up, over, down; target in Cartesian coordinates.
    JumpXyz = 0,
    /// Straight in joint space; Cartesian target.
    MoveJointXyz = 1,
    /// Straight in space; Cartesian target.
    MoveLineXyz = 2,
    /// Up, over, down; target in joint angles.
    JumpAngle = 3,
    /// Straight in joint space; joint target.
    MoveJointAngle = 4,
    /// Straight in space; joint target.
    MoveLineAngle = 5,
    /// Straight in joint space by joint increments.
    MoveJointIncrement = 6,
    /// Straight in space by Cartesian increments.
    MoveLineIncrement = 7,
    /// Straight in joint space by Cartesian increments.
    MoveJointXyzIncrement = 8,
    /// Up, over straight in space, down; Cartesian target.
    JumpLineXyz = 9,
}

impl PtpMode {
    /// All modes, in the order of their numbers.
    pub const ALL: [Self; 10] = [
        Self::JumpXyz,
        Self::MoveJointXyz,
        Self::MoveLineXyz,
        Self::JumpAngle,
        Self::MoveJointAngle,
        Self::MoveLineAngle,
        Self::MoveJointIncrement,
        Self::MoveLineIncrement,
        Self::MoveJointXyzIncrement,
        Self::JumpLineXyz,
    ];
}

impl CartesianLimits {
    /// The same number for every field: mm/s, deg/s, mm/s^2 and deg/s^2.
    #[must_use]
    pub const fn uniform(velocity: f32, acceleration: f32) -> Self {
        Self {
            xyz_velocity: velocity,
            r_velocity: velocity,
            xyz_acceleration: acceleration,
            r_acceleration: acceleration,
        }
    }

    /// Reads the 16 bytes that both the command and the reply carry.
    ///
    /// # Errors
    /// When there are fewer.
    pub fn read(fields: &mut PayloadFields<'_>) -> Result<Self, Malformed> {
        let [xyz_velocity, r_velocity, xyz_acceleration, r_acceleration] = fields.floats()?;
        Ok(Self { xyz_velocity, r_velocity, xyz_acceleration, r_acceleration })
    }
}

impl Ratios {
    /// Reads the 8 bytes that both the command and the reply carry.
    ///
    /// # Errors
    /// When there are fewer.
    pub fn read(fields: &mut PayloadFields<'_>) -> Result<Self, Malformed> {
        let [velocity, acceleration] = fields.floats()?;
        Ok(Self { velocity, acceleration })
    }
}

impl CpLimits {
    /// Reads the 13 bytes that both the command and the reply carry.
    ///
    /// # Errors
    /// When there are fewer.
    pub fn read(fields: &mut PayloadFields<'_>) -> Result<Self, Malformed> {
        let [plan_acceleration, junction_velocity, acceleration] = fields.floats()?;
        let is_real_time = fields.byte()? != 0;
        Ok(Self { plan_acceleration, junction_velocity, acceleration, is_real_time })
    }
}
