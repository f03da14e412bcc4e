//! A lens out of focus.

use super::{LibraryEffect, PLAIN, needs_surroundings};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::Defocus,
    equation: "L = L_map + (s^2 / 2) Laplacian L_map",
    source: "Pentland, IEEE PAMI 9, 1987",
    competing: &[EffectId::PhotoreceptorBandwidth, EffectId::FixedPole, EffectId::ExposureBlur],
    separating_recording: "two speeds: defocus is the same at both",
    requires: needs_surroundings,
    describe: |values| {
        format!("the event camera's image is blurred by {:.2} px more than the map", values[0])
    },
    ..PLAIN
};
