//! Thresholds that differ between pixels.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ThresholdMismatch,
    equation: "theta_p = theta exp(s e_p), e_p normal, fixed for each pixel; ON and OFF correlate",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008 (2.1 % contrast)",
    competing: &[EffectId::HotPixels, EffectId::Vignetting, EffectId::ShotNoise],
    separating_recording: "the same path twice: a pixel's own threshold is the same in both",
    describe: |values| {
        format!(
            "thresholds differ between pixels with a standard deviation of {:.0} %",
            values[0] * 100.0
        )
    },
    ..PLAIN
};
