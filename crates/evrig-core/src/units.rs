//! Physical units as types, so that a length is never added to a frequency.
//!
//! Only the units that occur in public signatures exist, with only the
//! operators that are used. Files carry the unit in the key's suffix
//! (`radius_mm`); the values are bare numbers there.

use serde::{Deserialize, Serialize};
use std::ops::{Add, Mul, Neg, Sub};

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident, $symbol:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl $name {
            /// The bare number in this unit.
            #[must_use]
            pub fn value(self) -> f64 {
                self.0
            }

            /// Distance from zero in the same unit.
            #[must_use]
            pub fn abs(self) -> Self {
                Self(self.0.abs())
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match f.precision() {
                    Some(digits) => write!(f, "{:.*} {}", digits, self.0, $symbol),
                    None => write!(f, "{} {}", self.0, $symbol),
                }
            }
        }

        impl Add for $name {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }

        impl Sub for $name {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }

        impl Neg for $name {
            type Output = Self;
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }

        impl Mul<f64> for $name {
            type Output = Self;
            fn mul(self, factor: f64) -> Self {
                Self(self.0 * factor)
            }
        }
    };
}

unit!(
    /// Data rate.
    BytesPerSecond,
    "B/s"
);
unit!(
    /// A length on the target, in the tool frame or in the workspace.
    Millimetres,
    "mm"
);
unit!(
    /// An angle; joints and wrists are given in degrees throughout.
    Degrees,
    "deg"
);
unit!(
    /// Events, frames or cycles per second.
    Hertz,
    "Hz"
);
unit!(
    /// A distance on a pixel grid.
    Pixels,
    "px"
);
unit!(
    /// A speed along the path.
    MillimetresPerSecond,
    "mm/s"
);
unit!(
    /// An acceleration along the path.
    MillimetresPerSecond2,
    "mm/s^2"
);
unit!(
    /// A joint's or the wrist's speed.
    DegreesPerSecond,
    "deg/s"
);
unit!(
    /// A joint's or the wrist's acceleration.
    DegreesPerSecond2,
    "deg/s^2"
);
unit!(
    /// The size of a pixel on a sensor.
    Micrometres,
    "um"
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_prints_its_symbol_with_the_asked_precision() {
        assert_eq!(format!("{:.1}", Millimetres(12.34)), "12.3 mm");
        assert_eq!(format!("{}", Hertz(25.0)), "25 Hz");
    }

    #[test]
    fn lengths_add_and_scale() {
        assert_eq!((Millimetres(1.0) + Millimetres(2.0)) * 2.0, Millimetres(6.0));
        assert_eq!((Degrees(10.0) - Degrees(30.0)).abs(), Degrees(20.0));
    }
}
