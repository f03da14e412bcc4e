//! ON and OFF thresholds that differ.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ThresholdAsymmetry,
    equation: "theta_on = q theta_off",
    source: "Wang et al., arXiv 2012.09378",
    competing: &[EffectId::JunctionLeak, EffectId::PhotocurrentLeak],
    separating_recording: "two speeds: an asymmetry is the same per cycle, a leak per second",
    describe: |values| {
        format!("an ON event takes {:.2} times the contrast of an OFF event", values[0])
    },
    ..PLAIN
};
