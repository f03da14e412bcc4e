//! Dark current of the event pixels.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::DarkCurrent,
    equation: "x = ln(L / L_white + d)",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    competing: &[EffectId::BlackLevel, EffectId::ToneCurve, EffectId::PhotoreceptorBandwidth],
    same_law: &[EffectId::BlackLevel],
    separating_recording: "dark frames with the lens cap on give the pedestal; five times more \
         light makes dark current negligible",
    describe: |values| {
        format!(
            "dark current of {:.1} % of white reduces the contrast of dark pixels",
            values[0] * 100.0
        )
    },
    ..PLAIN
};
