//! Effects of the arm.

use serde::{Deserialize, Serialize};

/// The tool swings along a line while it moves; nobody reports it (steppers and links, 20..200 Hz,
/// 0.01..0.3 mm). The swing grows with the tool's speed up to 10 mm/s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vibration {
    /// Swings a second.
    pub frequency_hz: f64,
    /// Amplitude at the tool.
    pub amplitude_mm: f64,
    /// Direction in the DAVIS's image, clockwise from the right.
    #[serde(default)]
    pub direction_deg: f64,
}
