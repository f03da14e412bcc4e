//! Frames that are not linear in light.

use super::{LibraryEffect, PLAIN, needs_shown};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ToneCurve,
    equation: "s = s_full (L / L_full)^g",
    source: "IEC 61966-2-1; picamera2: raw frames are linear, processed ones are not",
    competing: &[EffectId::BlackLevel, EffectId::DarkCurrent],
    separating_recording: "a step wedge, or frames of two cameras of the same grey",
    requires: |evidence| {
        needs_shown(
            evidence,
            EffectId::ToneCurve,
            "a power law of the frames cannot be separated from the threshold; it takes frames of \
             two cameras of the same target",
        )
    },
    ..PLAIN
};
