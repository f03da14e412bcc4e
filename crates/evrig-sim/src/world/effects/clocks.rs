//! Effects between the clocks of the cameras.
//!
//! The DAVIS's stamps are set once, late by the transport of its reset (ms), and run on a crystal
//! of their own (1..100 ppm).

use serde::{Deserialize, Serialize};

/// The DAVIS's stamps are late against the Pi's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockOffset {
    /// By so much at the world's beginning.
    pub offset_us: f64,
}

/// The DAVIS's clock runs fast.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockSkew {
    /// By so many parts per million, from the world's beginning.
    pub skew_ppm: f64,
}
