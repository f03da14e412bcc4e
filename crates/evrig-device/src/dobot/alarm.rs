//! Alarms in words: what happened and what to do.

use serde::{Serialize, Serializer};

/// The arm's alarm bits. Bit 0 is set after every power-up and is not a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Alarms {
    bits: u128,
}

impl Alarms {
    /// Length of the reply that carries them.
    pub const N_BYTES: usize = 16;

    /// Bit n is bit n % 8 of byte n / 8.
    #[must_use]
    pub const fn from_bytes(bytes: [u8; Self::N_BYTES]) -> Self {
        Self { bits: u128::from_le_bytes(bytes) }
    }

    /// The bytes of the reply.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; Self::N_BYTES] {
        self.bits.to_le_bytes()
    }

    /// Sets an alarm; codes past the 16 bytes do not exist on a Magician and are ignored.
    pub fn raise(&mut self, code: u8) {
        self.bits |= 1_u128.checked_shl(u32::from(code)).unwrap_or(0);
    }

    /// Whether the arm was powered up since alarms were last cleared, so it was not homed since.
    #[must_use]
    pub const fn is_fresh_from_power_up(self) -> bool {
        self.bits & 1 != 0
    }

    /// The alarms that are faults: all but the power-up bit.
    pub fn faults(self) -> impl Iterator<Item = Alarm> {
        (1..128).filter(move |code| self.bits >> code & 1 != 0).map(Alarm)
    }

    /// Whether any alarm but the power-up bit is set.
    #[must_use]
    pub const fn has_fault(self) -> bool {
        self.bits & !1 != 0
    }
}

impl std::fmt::Display for Alarms {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.has_fault() {
            return f.write_str("no alarm");
        }
        for (n, alarm) in self.faults().enumerate() {
            write!(f, "{}{alarm}", if n == 0 { "" } else { "; " })?;
        }
        Ok(())
    }
}

impl Serialize for Alarms {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.faults().map(|alarm| alarm.0))
    }
}

/// One alarm by its code, 0..=127 on a Magician.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alarm(pub u8);

impl Alarm {
    /// The target lies at a singularity.
    pub const PLAN_SINGULARITY: Self = Self(0x10);
    /// The target lies outside the reach.
    pub const PLAN_OUT_OF_REACH: Self = Self(0x11);
    /// The target lies outside the joint limits.
    pub const PLAN_JOINT_LIMIT: Self = Self(0x12);
    /// A point of an arc is given twice.
    pub const PLAN_REPEATED_POINT: Self = Self(0x13);
    /// The points of an arc lie on a line.
    pub const PLAN_ARC_INPUT: Self = Self(0x14);

    /// What the alarm means and what to do about it.
    #[must_use]
    pub fn explain(self) -> Explanation {
        let code = self.0;
        if let Some((_, description, remedy)) = SINGLE.iter().find(|(known, ..)| *known == code) {
            return Explanation { description: (*description).to_owned(), remedy };
        }
        let axis = |first: u8, per_axis: u8| (code - first) / per_axis + 1;
        let (description, remedy) = match code {
            0x30..=0x33 => (
                format!("joint {} was asked to turn faster than it can", axis(0x30, 1)),
                "lower the speed or keep away from the arm's own axis",
            ),
            0x40..=0x47 => {
                let limit = if code.is_multiple_of(2) { "upper" } else { "lower" };
                (
                    format!("joint {} is at its {limit} limit", axis(0x40, 2)),
                    "move the joint back by hand (hold UNLOCK) or by jogging, then clear",
                )
            }
            0x50..=0x53 => (
                format!("joint {} lost steps: it hit something or was too fast", axis(0x50, 1)),
                "free the arm, lower the acceleration or the load, home again",
            ),
            0x60..=0x6b => (
                format!("the motor driver of joint {} reports a fault", axis(0x60, 3)),
                "switch the arm off for ten seconds; if it comes back, have it serviced",
            ),
            0x70..=0xb2 => (
                format!("motor fault 0x{code:02x} of another Dobot model"),
                "check that the device is a Magician; switch it off for ten seconds",
            ),
            _ => (
                format!("alarm 0x{code:02x}, which no document names"),
                "clear it; if it comes back, switch the arm off for ten seconds",
            ),
        };
        Explanation { description, remedy }
    }
}

impl std::fmt::Display for Alarm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Explanation { description, remedy } = self.explain();
        write!(f, "alarm 0x{:02x}: {description} ({remedy})", self.0)
    }
}

/// An alarm in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Explanation {
    /// What happened.
    pub description: String,
    /// What to do.
    pub remedy: &'static str,
}

const IN_REACH: &str =
    "move the path into the workspace (`evrig plan` shows the point), then clear";
const NOT_STRAIGHT: &str = "give three different points that do not lie on a line";
const SERVICE: &str = "switch the arm off for ten seconds; if it comes back, flash the firmware";
const SLOWER: &str = "lower the speed or shorten the path, then clear";

/// Code, meaning, remedy.
const SINGLE: &[(u8, &str, &str)] = &[
    (0x00, "the arm was powered up", "nothing: this is not a fault"),
    (0x01, "the firmware does not know a command it was sent", "update the firmware, then clear"),
    (0x02, "the file system of the controller failed", SERVICE),
    (0x03, "the controller cannot reach its motor processor", SERVICE),
    (0x04, "an angle sensor failed", SERVICE),
    (0x10, "the target is at a singularity (on the base axis)", IN_REACH),
    (0x11, "the target is outside the reach", IN_REACH),
    (0x12, "the target is outside the joint limits", IN_REACH),
    (0x13, "a point of the path is given twice", NOT_STRAIGHT),
    (0x14, "the points of an arc lie on a line", NOT_STRAIGHT),
    (0x15, "the jump is higher than its limit", "lower the jump height, then clear"),
    (0x16, "the arm would have to change its configuration on a line", IN_REACH),
    (0x17, "a line leaves the workspace", IN_REACH),
    (0x18, "an arc leaves the workspace", IN_REACH),
    (0x19, "the kind of motion does not exist", "update evrig, then clear"),
    (0x1a, "the speed or acceleration is not possible", SLOWER),
    (0x1b, "a continuous path could not be planned", SLOWER),
    (0x20, "on its way the arm came to a singularity", IN_REACH),
    (0x21, "on its way the arm came to the end of its reach", IN_REACH),
    (0x22, "on its way the arm came to a joint limit", IN_REACH),
    (
        0x48,
        "the parallelogram of rear arm and forearm is at its upper limit",
        "move the arm back by hand (hold UNLOCK), then clear",
    ),
    (
        0x49,
        "the parallelogram of rear arm and forearm is at its lower limit",
        "move the arm back by hand (hold UNLOCK), then clear",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_power_up_bit_is_not_a_fault() {
        // As a real arm answered after power-up.
        let mut bytes = [0; 16];
        bytes[0] = 1;
        let alarms = Alarms::from_bytes(bytes);
        assert!(alarms.is_fresh_from_power_up());
        assert!(!alarms.has_fault());
        assert_eq!(alarms.to_string(), "no alarm");
    }

    #[test]
    fn a_bit_is_counted_from_the_low_end_of_its_byte() {
        let mut bytes = [0; 16];
        bytes[2] = 0b100;
        bytes[8] = 0b10;
        let codes: Vec<u8> = Alarms::from_bytes(bytes).faults().map(|alarm| alarm.0).collect();
        assert_eq!(codes, [0x12, 0x41]);
        assert_eq!(Alarms::from_bytes(bytes).to_bytes(), bytes);
    }

    #[test]
    fn every_code_has_words_and_a_remedy() {
        for code in 0..=u8::MAX {
            let Explanation { description, remedy } = Alarm(code).explain();
            assert!(description.len() > 10 && remedy.len() > 10, "0x{code:02x}");
        }
        assert!(Alarm(0x45).to_string().contains("joint 3 is at its lower limit"));
        assert!(Alarm(0x68).to_string().contains("joint 3"));
    }
}
