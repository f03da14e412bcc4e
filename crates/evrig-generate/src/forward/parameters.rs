//! What decides the events of a forward simulation, and why one is refused.

use crate::effect::{EffectError, EffectSet};
use crate::voltmeter::Coefficients;
use evrig_core::geometry::Size;
use serde::{Deserialize, Serialize};

/// Parameters of a forward simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForwardParameters {
    /// The voltmeter's k, in the digital units of
    /// [`Drive::white_dn`](evrig_core::drive::Drive::white_dn).
    pub k: Coefficients,
    /// Physical effects.
    #[serde(default, skip_serializing_if = "EffectSet::is_empty")]
    pub effects: EffectSet,
    /// Sampling step of the signal, µs, 10 to 100,000.
    #[serde(default = "default_step_us")]
    pub step_us: u32,
}

const fn default_step_us() -> u32 {
    1_000
}

/// The most events a pixel may fire a second, on average over a window.
pub(super) const MAX_EVENT_RATE_HZ: u32 = 20_000;

/// Why a forward simulation is refused.
#[derive(Debug, thiserror::Error)]
pub enum ForwardError {
    /// An effect is out of range or lacks its input.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A step out of range.
    #[error("the step is {step_us} us; expected 10 to 100000")]
    Step {
        /// What was given.
        step_us: u32,
    },
    /// An empty window or one of too many instants.
    #[error(
        "the window runs from {} to {} us, {n_steps} steps of {step_us} us; expected 1 to {limit} \
         steps: generate in shorter windows or at a larger step", .window_us[0], .window_us[1]
    )]
    Window {
        /// What was given.
        window_us: [i64; 2],
        /// The step.
        step_us: u32,
        /// How many of them.
        n_steps: i128,
        /// The most that are allowed.
        limit: i128,
    },
    /// A constant of the camera out of range.
    #[error("{key} of the camera is {value}; expected {low} to {high}")]
    Camera {
        /// The constant.
        key: &'static str,
        /// Its value.
        value: f64,
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
    },
    /// A drive whose white level is not a positive number.
    #[error("the drive's white is {white_dn} DN; expected a finite value above 0")]
    White {
        /// What the drive states.
        white_dn: f64,
    },
    /// A pixel off the sensor.
    #[error("pixel ({x}, {y}) is not on the sensor of {size}")]
    Pixel {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
        /// The sensor.
        size: Size,
    },
    /// Parameters that give an unbounded event rate.
    #[error(
        "pixel ({x}, {y}) fires more than {limit} times in a second; check k, the effects and \
         the unit of the drive"
    )]
    TooManyEvents {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
        /// The most that is allowed.
        limit: u32,
    },
}
