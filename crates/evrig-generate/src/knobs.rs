//! The settings a person thinks in, and what each does to k: the one place of this mapping.
//!
//! After Raw2Event's table of user-intuitive parameters. Where the table names two k for one
//! setting, the mapping states how they change together: contrast sensitivity represents the
//! pixel's threshold, which scales the signal (k1) and the dark leak (k4) alike; temporal
//! jitter multiplies both sources of noise (k3 and k6).

use super::voltmeter::Coefficients;
use crate::parameter_error::ParameterError;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A setting of the event model in a user's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Knob {
    /// Response to changes of brightness.
    EventSensitivity,
    /// Ability to see weak edges.
    ContrastSensitivity,
    /// Events where it is bright and nothing moves.
    BrightLeakage,
    /// Randomness of event times.
    TemporalJitter,
    /// Events where it is dark and nothing moves.
    DarkNoiseFloor,
    /// Random events everywhere.
    GlobalNoise,
}

/// What a knob is, for help texts and for the axis of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnobDescription {
    /// The name on the command line and in files.
    pub name: &'static str,
    /// What it controls.
    pub controls: &'static str,
    /// What turning it does.
    pub effect: &'static str,
    /// How it acts on k, and the unit of its value.
    pub acts_on: &'static str,
    /// Lowest and highest recommended value.
    pub recommended: [f64; 2],
}

/// A knob turned to a value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnobSetting {
    /// Which.
    pub knob: Knob,
    /// To what, in the knob's own unit.
    pub value: f64,
}

impl Knob {
    /// All knobs, in the paper's order.
    pub const ALL: [Self; 6] = [
        Self::EventSensitivity,
        Self::ContrastSensitivity,
        Self::BrightLeakage,
        Self::TemporalJitter,
        Self::DarkNoiseFloor,
        Self::GlobalNoise,
    ];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.describe().name
    }

    /// What it is, does and may be.
    #[must_use]
    pub const fn describe(self) -> KnobDescription {
        match self {
            Self::EventSensitivity => KnobDescription {
                name: "event-sensitivity",
                controls: "response to changes of brightness (exposure)",
                effect: "higher: events are easier to trigger; lower: less responsive",
                acts_on: "k1 (events per log unit of brightness; k2 limits it in the dark)",
                recommended: [1.0, 10.0],
            },
            Self::ContrastSensitivity => KnobDescription {
                name: "contrast-sensitivity",
                controls: "ability to detect edges",
                effect: "higher: weak edges make events; lower: a higher threshold for all events",
                acts_on: "k1, and k4 in the same proportion (events per log unit of brightness)",
                recommended: [1.0, 10.0],
            },
            Self::BrightLeakage => KnobDescription {
                name: "bright-leakage",
                controls: "events in static bright areas",
                effect: "higher: static bright areas fire On more often",
                acts_on: "k5 (events per us and digital number)",
                recommended: [0.0, 1e-7],
            },
            Self::TemporalJitter => KnobDescription {
                name: "temporal-jitter",
                controls: "randomness of event times",
                effect: "higher: event times scatter; lower: fewer spurious events",
                acts_on: "k3 and k6, both multiplied by it (1 leaves them as they are)",
                recommended: [0.0, 10.0],
            },
            Self::DarkNoiseFloor => KnobDescription {
                name: "dark-noise-floor",
                controls: "noise in dark or still background",
                effect: "higher: more background events in dark or still regions",
                acts_on: "k4 (events per us)",
                recommended: [0.0, 1e-7],
            },
            Self::GlobalNoise => KnobDescription {
                name: "global-noise",
                controls: "overall random event noise",
                effect: "higher: random events across the whole scene",
                acts_on: "k6 (thresholds per sqrt(us))",
                recommended: [0.0, 1e-4],
            },
        }
    }

    /// `k` with this knob at `value`.
    ///
    /// # Errors
    /// A value that takes a k out of its range, by name of the k.
    pub fn turn(self, k: Coefficients, value: f64) -> Result<Coefficients, ParameterError> {
        let [k1, k2, k3, k4, k5, k6] = k.k();
        Coefficients::new(match self {
            Self::EventSensitivity => [value, k2, k3, k4, k5, k6],
            Self::ContrastSensitivity => {
                let gain = if k1 > 0.0 { value / k1 } else { 1.0 };
                [value, k2, k3, k4 * gain, k5, k6]
            }
            Self::BrightLeakage => [k1, k2, k3, k4, value, k6],
            Self::TemporalJitter => [k1, k2, k3 * value, k4, k5, k6 * value],
            Self::DarkNoiseFloor => [k1, k2, k3, value, k5, k6],
            Self::GlobalNoise => [k1, k2, k3, k4, k5, value],
        })
    }

    /// Position of this knob in `k`: [`Knob::turn`] to it changes nothing.
    #[must_use]
    pub fn position(self, k: Coefficients) -> f64 {
        let [k1, _, _, k4, k5, k6] = k.k();
        match self {
            Self::EventSensitivity | Self::ContrastSensitivity => k1,
            Self::BrightLeakage => k5,
            Self::TemporalJitter => 1.0,
            Self::DarkNoiseFloor => k4,
            Self::GlobalNoise => k6,
        }
    }
}

named!(Knob, "knob");

impl FromStr for KnobSetting {
    type Err = ParameterError;

    /// Reads `name=value`.
    fn from_str(text: &str) -> Result<Self, ParameterError> {
        let not_a_setting = || ParameterError::NotASetting { text: text.to_owned() };
        let (name, value) = text.split_once('=').ok_or_else(not_a_setting)?;
        let knob = name.trim().parse()?;
        Ok(Self { knob, value: value.trim().parse().map_err(|_| not_a_setting())? })
    }
}

impl fmt::Display for KnobSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={:?}", self.knob, self.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_knob_turned_to_its_present_position_changes_nothing_and_elsewhere_only_its_own_k() {
        let owned: [&[usize]; 6] = [&[0], &[0, 3], &[4], &[2, 5], &[3], &[5]];
        for (knob, owned) in Knob::ALL.into_iter().zip(owned) {
            let k = Coefficients::RAW2DVS346;
            let position = knob.position(k);
            assert_eq!(knob.turn(k, position).unwrap(), k, "{knob}");
            let turned = knob.turn(k, 2.0 * position).unwrap().k();
            for (i, (turned, k)) in turned.iter().zip(k.k()).enumerate() {
                let factor = if owned.contains(&i) { 2.0 } else { 1.0 };
                assert!((turned - factor * k).abs() <= 1e-12 * k, "{knob}, k{}", i + 1);
            }
        }
    }

    #[test]
    fn every_recommended_end_is_a_possible_k() {
        for knob in Knob::ALL {
            for value in knob.describe().recommended {
                assert!(knob.turn(Coefficients::RGB2DVS346, value).is_ok(), "{knob}");
            }
        }
    }

    #[test]
    fn settings_are_read_from_text_and_wrong_ones_named() {
        let setting: KnobSetting = "global-noise = 1e-5".parse().unwrap();
        assert_eq!(setting, KnobSetting { knob: Knob::GlobalNoise, value: 1e-5 });
        assert_eq!(setting.to_string().parse::<KnobSetting>().unwrap(), setting);
        let error = |text: &str| text.parse::<KnobSetting>().unwrap_err().to_string();
        assert!(error("globl-noise=1").contains("did you mean `global-noise`"));
        assert!(error("global-noise=x").contains("name=value"));
        let k = Coefficients::DVS346;
        let error = Knob::TemporalJitter.turn(k, -1.0).unwrap_err().to_string();
        assert!(error.contains("k3"), "{error}");
    }
}
