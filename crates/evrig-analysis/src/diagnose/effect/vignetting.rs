//! Light loss towards the image corners.

use super::{LibraryEffect, PLAIN, needs_shown};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::Vignetting,
    equation: "L (1 - c (r / r_corner)^2)",
    source: "Goldman, IEEE PAMI 32, 2010",
    competing: &[EffectId::ThresholdMismatch, EffectId::MovingShadow],
    separating_recording: "a path that moves the same texture from the center to a corner",
    requires: |evidence| {
        needs_shown(
            evidence,
            EffectId::Vignetting,
            "a constant factor cancels in the logarithm; it takes a path that moves the same \
             texture from the center to a corner",
        )
    },
    ..PLAIN
};
