//! Leak independent of light.

use super::{LibraryEffect, PLAIN, needs_span};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::JunctionLeak,
    equation: "dV = r theta dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    competing: &[
        EffectId::PhotocurrentLeak,
        EffectId::BackgroundActivity,
        EffectId::ThresholdAsymmetry,
    ],
    separating_recording: "a static segment in the dark: a junction leak remains there, a \
         photocurrent leak does not",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| {
        format!(
            "every pixel drifts towards ON by {:.2} thresholds per second, independent of light",
            values[0]
        )
    },
    ..PLAIN
};
