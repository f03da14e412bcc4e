//! Frames that are not linear in light.

use super::{Candidate, EffectId, PLAIN, needs_shown};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ToneCurve,
    equation: "s = s_full (L / L_full)^g",
    source: "IEC 61966-2-1; picamera2: raw frames are linear, processed ones are not",
    rivals: &[EffectId::BlackLevel, EffectId::DarkCurrent],
    splitter: "a step wedge, or frames of two cameras of the same grey",
    needs: |evidence| {
        needs_shown(
            evidence,
            EffectId::ToneCurve,
            "a power law of the frames is one number with the threshold; it takes frames of two cameras \
             of the same print",
        )
    },
    ..PLAIN
};
