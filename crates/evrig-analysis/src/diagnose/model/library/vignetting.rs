//! A picture that darkens towards its corners.

use super::{Candidate, EffectId, PLAIN, needs_shown};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::Vignetting,
    equation: "L (1 - c (r / r_corner)^2)",
    source: "Goldman, IEEE PAMI 32, 2010",
    rivals: &[EffectId::ThresholdMismatch, EffectId::MovingShadow],
    splitter: "a path that leads the same paper from the middle to a corner",
    needs: |evidence| {
        needs_shown(
            evidence,
            EffectId::Vignetting,
            "what does not change with time cancels in the logarithm; it takes a path that leads the \
             same paper from the middle to a corner",
        )
    },
    ..PLAIN
};
