//! Leak proportional to light.

use super::{LibraryEffect, PLAIN, needs_span};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::PhotocurrentLeak,
    equation: "dV = r theta L / L_white dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    competing: &[EffectId::JunctionLeak, EffectId::ThresholdAsymmetry],
    separating_recording: "a static segment at two levels of light",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| {
        format!(
            "white pixels drift towards ON by {:.2} thresholds per second, others in proportion \
             to their light",
            values[0]
        )
    },
    ..PLAIN
};
