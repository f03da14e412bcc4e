//! A lens out of focus.

use super::{Candidate, EffectId, Freed, Nuisance, PLAIN, needs_surroundings};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::Defocus,
    equation: "L = L_map + (s^2 / 2) Laplacian L_map",
    source: "Pentland, IEEE PAMI 9, 1987",
    frees: &[Freed { nuisance: Nuisance::BlurPx2, range: [-2.0, 4.0] }],
    starts: |_| vec![vec![0.4], vec![1.2], vec![-0.4]],
    report: |values| {
        let variance = values[Nuisance::BlurPx2 as usize];
        vec![variance.abs().sqrt() * variance.signum()]
    },
    rivals: &[EffectId::PhotoreceptorBandwidth, EffectId::FixedPole, EffectId::ExposureBlur],
    splitter: "two speeds: a blurred lens takes the same detail at both",
    needs: needs_surroundings,
    says: |values| {
        format!("the event camera sees the print blurred by {:.2} px more than the map", values[0])
    },
    ..PLAIN
};
