//! Pixels that never fire.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::DeadPixels,
    equation: "a share of the pixels has no events",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    competing: &[EffectId::ThresholdMismatch],
    separating_recording: "a faster pass with more contrast",
    describe: |values| format!("{:.2} % of the pixels never fire", values[0] * 100.0),
    ..PLAIN
};
