//! A shadow that moves over the target.

use super::{LibraryEffect, PLAIN, needs_shown};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::MovingShadow,
    equation: "L (1 - d f(x cos a + y sin a - v t))",
    source: "an object moves between lamp and target",
    competing: &[EffectId::Vignetting, EffectId::Flicker, EffectId::Adaptation],
    separating_recording: "a static segment: the shadow moves on while the target rests",
    requires: |evidence| {
        needs_shown(
            evidence,
            EffectId::MovingShadow,
            "separating moving light from the target takes many frames of a second camera",
        )
    },
    ..PLAIN
};
