//! Where the tool is: in the workspace, and in the arm's joints.

use evrig_core::units::{Degrees, Millimetres};
use serde::{Deserialize, Serialize};
use std::fmt;

/// The tool point in the arm's base frame: origin on the shoulder axis, x forwards, y left, z up.
///
/// The wrist keeps the tool level, so that one angle states its attitude.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// Forwards from the base.
    #[serde(rename = "x_mm")]
    pub x: Millimetres,
    /// To the left of the base, seen along x.
    #[serde(rename = "y_mm")]
    pub y: Millimetres,
    /// Up from the shoulder axis (138 mm above the table on a Magician).
    #[serde(rename = "z_mm")]
    pub z: Millimetres,
    /// Attitude of the tool about z in the base frame, anticlockwise seen from above.
    #[serde(rename = "r_deg")]
    pub r: Degrees,
}

/// The Magician's joint angles, as its pose reply gives them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Joints {
    /// Base, about z.
    #[serde(rename = "j1_deg")]
    pub j1: Degrees,
    /// Rear arm, from the vertical, forwards positive.
    #[serde(rename = "j2_deg")]
    pub j2: Degrees,
    /// Forearm, from the horizontal (absolute, not relative to the rear arm), down positive.
    #[serde(rename = "j3_deg")]
    pub j3: Degrees,
    /// Wrist, about z.
    #[serde(rename = "j4_deg")]
    pub j4: Degrees,
}

impl Pose {
    /// A pose from `[x mm, y mm, z mm, r deg]`, the order of the arm's messages.
    #[must_use]
    pub const fn from_mm_deg([x, y, z, r]: [f64; 4]) -> Self {
        Self { x: Millimetres(x), y: Millimetres(y), z: Millimetres(z), r: Degrees(r) }
    }

    /// `[x mm, y mm, z mm, r deg]`, the order of the arm's messages.
    #[must_use]
    pub const fn to_mm_deg(self) -> [f64; 4] {
        [self.x.0, self.y.0, self.z.0, self.r.0]
    }

    /// `[x, y, z]` in millimetres.
    #[must_use]
    pub const fn position_mm(self) -> [f64; 3] {
        [self.x.0, self.y.0, self.z.0]
    }

    /// Straight distance between the two tool points.
    #[must_use]
    pub fn distance(self, other: Self) -> Millimetres {
        let [dx, dy, dz] = (self - other).position_mm();
        Millimetres((dx * dx + dy * dy + dz * dz).sqrt())
    }
}

impl std::ops::Sub for Pose {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z, r: self.r - other.r }
    }
}

impl fmt::Display for Pose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z, r] = self.to_mm_deg();
        write!(f, "x {x:.2}, y {y:.2}, z {z:.2} mm, r {r:.2} deg")
    }
}

impl Joints {
    /// Joint angles from `[J1, J2, J3, J4]` in degrees, the order of the arm's messages.
    #[must_use]
    pub const fn from_deg([j1, j2, j3, j4]: [f64; 4]) -> Self {
        Self { j1: Degrees(j1), j2: Degrees(j2), j3: Degrees(j3), j4: Degrees(j4) }
    }

    /// `[J1, J2, J3, J4]` in degrees, the order of the arm's messages.
    #[must_use]
    pub const fn to_deg(self) -> [f64; 4] {
        [self.j1.0, self.j2.0, self.j3.0, self.j4.0]
    }
}

impl fmt::Display for Joints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [j1, j2, j3, j4] = self.to_deg();
        write!(f, "J1 {j1:.2}, J2 {j2:.2}, J3 {j3:.2}, J4 {j4:.2} deg")
    }
}
