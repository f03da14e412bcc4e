//! Inertial samples and triggers.

use crate::time::{Davis, Stamp};

/// One sample of the camera's inertial unit, in the axes and units in which AEDAT4 stores it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// When it was taken.
    pub stamp: Stamp<Davis>,
    /// Degrees Celsius.
    pub temperature_c: f32,
    /// Acceleration along x, y, z in g (9.81 m/s^2).
    pub acceleration_g: [f32; 3],
    /// Angular rate about x, y, z in degrees per second.
    pub rotation_deg_per_s: [f32; 3],
    /// Magnetic field along x, y, z in microtesla; zero where the unit has no compass.
    pub magnetic_ut: [f32; 3],
}

/// A trigger on a camera's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trigger {
    /// When it happened.
    pub stamp: Stamp<Davis>,
    /// What happened.
    pub kind: TriggerKind,
}

/// Kind of a trigger.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TriggerKind {
    /// The camera's clock was reset.
    TimestampReset,
    /// The signal input rose.
    SignalRose,
    /// The signal input fell.
    SignalFell,
    /// A pulse on the signal input.
    SignalPulse,
    /// The camera's own generator rose.
    GeneratorRose,
    /// The camera's own generator fell.
    GeneratorFell,
    /// A frame's readout began.
    FrameBegan,
    /// A frame's readout ended.
    FrameEnded,
    /// A frame's exposure began.
    ExposureBegan,
    /// A frame's exposure ended.
    ExposureEnded,
    /// An unknown code, kept as it is.
    Other(i8),
}

/// The kinds that have a code, in the order of their codes 0..=9 (AEDAT4, `triggers.fbs`).
const CODED: [TriggerKind; 10] = [
    TriggerKind::TimestampReset,
    TriggerKind::SignalRose,
    TriggerKind::SignalFell,
    TriggerKind::SignalPulse,
    TriggerKind::GeneratorRose,
    TriggerKind::GeneratorFell,
    TriggerKind::FrameBegan,
    TriggerKind::FrameEnded,
    TriggerKind::ExposureBegan,
    TriggerKind::ExposureEnded,
];

impl TriggerKind {
    /// The kind of an AEDAT4 code.
    #[must_use]
    pub fn from_code(code: i8) -> Self {
        let coded = usize::try_from(code).ok().and_then(|code| CODED.get(code));
        coded.copied().unwrap_or(Self::Other(code))
    }

    /// The AEDAT4 code of the kind.
    #[must_use]
    pub fn code(self) -> i8 {
        match self {
            Self::Other(code) => code,
            coded => CODED.iter().position(|kind| *kind == coded).map_or(0, |code| code as i8),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_keeps_its_value() {
        for code in i8::MIN..=i8::MAX {
            assert_eq!(TriggerKind::from_code(code).code(), code);
        }
        assert_eq!(TriggerKind::from_code(8), TriggerKind::ExposureBegan);
        assert_eq!(TriggerKind::from_code(-3), TriggerKind::Other(-3));
    }
}
