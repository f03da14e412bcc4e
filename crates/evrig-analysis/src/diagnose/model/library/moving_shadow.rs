//! A shadow that crosses the print.

use super::{CandidateEffect, EffectId, PLAIN, needs_shown};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::MovingShadow,
    equation: "L (1 - d f(x cos a + y sin a - v t))",
    source: "what stands between lamp and print moves",
    competing: &[EffectId::Vignetting, EffectId::Flicker, EffectId::Adaptation],
    separating_recording: "a static segment: a shadow moves on while the print stays",
    requires: |evidence| {
        needs_shown(
            evidence,
            EffectId::MovingShadow,
            "light that moves over the print is told from the print by many frames of it from a second \
             camera",
        )
    },
    ..PLAIN
};
