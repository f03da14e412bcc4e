//! A pedestal of the frames that differs from the stated one.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::BlackLevel,
    equation: "x = ln(L - b)",
    source: "Sony IMX708 and libcamera: SensorBlackLevels",
    competing: &[EffectId::DarkCurrent, EffectId::ToneCurve],
    separating_recording: "dark frames with the lens cap on",
    describe: |values| {
        format!("the black level of the frames is {:.1} DN above the stated one", values[0])
    },
    ..PLAIN
};
