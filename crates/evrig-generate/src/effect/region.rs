//! Where an effect acts: everywhere, or in a rectangle of pixels.

use super::error::EffectError;
use evrig_core::effect_id::EffectId;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// Pixels to which an effect is limited; a side that is not given is not limited.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// First column, and the one behind the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x_px: Option<[f64; 2]>,
    /// First row, and the one behind the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y_px: Option<[f64; 2]>,
}

impl Region {
    /// Whether a pixel lies within.
    #[must_use]
    pub fn contains(&self, x: u16, y: u16) -> bool {
        let within = |side: Option<[f64; 2]>, p: u16| {
            side.is_none_or(|[low, high]| (low..high).contains(&f64::from(p)))
        };
        within(self.x_px, x) && within(self.y_px, y)
    }

    pub(super) fn check(&self, id: EffectId) -> Result<(), EffectError> {
        for (key, side) in [("x_px", self.x_px), ("y_px", self.y_px)] {
            if let Some([low, high]) =
                side.filter(|[low, high]| low.partial_cmp(high) != Some(Ordering::Less))
            {
                return Err(EffectError::EmptyRegion { id, key, low, high });
            }
        }
        Ok(())
    }
}
