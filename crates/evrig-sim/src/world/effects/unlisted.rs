//! Effects outside the library: a diagnosis must report them as unexplained.

use serde::{Deserialize, Serialize};

/// The camera's logic passes an event only when one of its eight neighbours fired shortly before
/// (background-activity filter in the FPGA, on by default in some set-ups).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SupportFilter {
    /// How long a neighbour's event counts.
    pub window_us: f64,
}

/// The photoreceptor's output follows at most so fast (large-signal slew; arXiv 2404.17771).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlewLimit {
    /// Highest rate of change of the log signal.
    pub per_s: f64,
}

/// Each event raises the pixel's thresholds, which then recover.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThresholdFatigue {
    /// Rise an event, as a share of the threshold.
    pub rise: f64,
    /// Time constant of the recovery.
    pub recovery_s: f64,
}
