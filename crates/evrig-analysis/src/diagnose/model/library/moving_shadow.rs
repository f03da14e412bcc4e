//! A shadow that crosses the print.

use super::{Candidate, EffectId, PLAIN, needs_shown};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::MovingShadow,
    equation: "L (1 - d f(x cos a + y sin a - v t))",
    source: "what stands between lamp and print moves",
    rivals: &[EffectId::Vignetting, EffectId::Flicker, EffectId::Adaptation],
    splitter: "a static segment: a shadow moves on while the print stays",
    needs: |evidence| {
        needs_shown(
            evidence,
            EffectId::MovingShadow,
            "light that moves over the print is told from the print by many frames of it from a second \
             camera",
        )
    },
    ..PLAIN
};
