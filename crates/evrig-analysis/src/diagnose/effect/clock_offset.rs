//! A clock offset that differs from the stated one.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ClockOffset,
    equation: "t_DAVIS = t + d",
    source: "clock map of the session",
    competing: &[
        EffectId::FixedPole,
        EffectId::PhotoreceptorBandwidth,
        EffectId::RollingShutter,
        EffectId::Misregistration,
    ],
    inseparable: &[EffectId::PixelLatency],
    separating_recording: "a flash that both cameras see",
    describe: |values| {
        let way = if values[0] > 0.0 { "late" } else { "early" };
        format!(
            "the event camera's stamps are {:.0} us {way} relative to the light",
            values[0].abs()
        )
    },
    ..PLAIN
};
