//! What a generation does to its frames before the model, and which physical effects act.

use evrig_generate::effect::EffectSet;
use evrig_generate::input::FramePreparation;
use serde::{Deserialize, Serialize};

/// FramePreparation of frames, interpolation between them, and physical effects beside the model.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Colour, pedestal, exposure.
    #[serde(default)]
    pub preparation: FramePreparation,
    /// Longest interval between frames after interpolation, µs; none without interpolation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interpolate_us: Option<u32>,
    /// Whether the interpolation follows the motion of the target plane.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub in_plane: bool,
    /// Physical effects.
    #[serde(default, skip_serializing_if = "EffectSet::is_empty")]
    pub effects: EffectSet,
}
