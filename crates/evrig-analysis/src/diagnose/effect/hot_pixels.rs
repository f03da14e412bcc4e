//! Pixels with a high background rate.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::HotPixels,
    equation: "a share h of the pixels fires at rate b",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    competing: &[EffectId::BackgroundActivity, EffectId::ThresholdMismatch],
    separating_recording: "a static segment: hot pixels fire there too",
    describe: |values| format!("{:.2} % of the pixels fire by themselves", values[0] * 100.0),
    ..PLAIN
};
