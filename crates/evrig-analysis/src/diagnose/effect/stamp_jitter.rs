//! Time stamps with random errors.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::StampJitter,
    equation: "t = t_event + s e, so var(r) = s^2 x'^2",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    competing: &[EffectId::ShotNoise, EffectId::FrameNoise],
    separating_recording: "two speeds: stamp jitter is constant in time, threshold noise is \
         constant in contrast",
    describe: |values| format!("time stamps have a jitter of {:.0} us", values[0]),
    ..PLAIN
};
