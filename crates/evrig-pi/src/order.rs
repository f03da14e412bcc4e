//! What a host orders of the agent: how frames are taken, and how they travel.

pub use evrig_core::delivery::{Coding, Focus, RgbDelivery};

use evrig_core::geometry::Size;
use evrig_core::time::Span;
use evrig_core::units::Hertz;
use serde::{Deserialize, Serialize};

/// How frames are to be taken; the agent answers with what it read back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaptureSettings {
    /// Columns and rows.
    pub size: Size,
    /// Frames a second.
    #[serde(rename = "frame_rate_hz")]
    pub frame_rate: Hertz,
    /// How long a row sees light, ns.
    #[serde(rename = "exposure_ns")]
    pub exposure: Span,
    /// Analogue gain.
    pub gain: f64,
    /// Whether raw frames are wanted.
    pub raw: bool,
    /// Whether RGB frames are wanted.
    pub rgb: bool,
}

/// How frames travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Delivery {
    /// How images are coded.
    pub coding: Coding,
    /// When RGB frames travel.
    pub rgb: RgbDelivery,
}

/// All that a host orders before a take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaptureOrder {
    /// How frames are taken.
    pub settings: CaptureSettings,
    /// What the lens does.
    pub focus: Focus,
    /// How frames travel.
    pub delivery: Delivery,
}
