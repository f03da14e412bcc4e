//! Random events.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::BackgroundActivity,
    equation: "events at rate b, independent of light and past",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008",
    competing: &[EffectId::ShotNoise, EffectId::JunctionLeak, EffectId::HotPixels],
    separating_recording: "a static segment: noise alternates in polarity, background does not",
    describe: |values| format!("every pixel has {:.2} background events per second", values[0]),
    ..PLAIN
};
