//! A lens out of focus.

use super::{CandidateEffect, EffectId, FreedNuisance, Nuisance, PLAIN, needs_surroundings};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::Defocus,
    equation: "L = L_map + (s^2 / 2) Laplacian L_map",
    source: "Pentland, IEEE PAMI 9, 1987",
    freed: &[FreedNuisance { nuisance: Nuisance::BlurPx2, range: [-2.0, 4.0] }],
    starting_points: |_| vec![vec![0.4], vec![1.2], vec![-0.4]],
    report_freed: |values| {
        let variance = values[Nuisance::BlurPx2 as usize];
        vec![variance.abs().sqrt() * variance.signum()]
    },
    competing: &[EffectId::PhotoreceptorBandwidth, EffectId::FixedPole, EffectId::ExposureBlur],
    separating_recording: "two speeds: defocus is the same at both",
    requires: needs_surroundings,
    describe: |values| {
        format!("the event camera's image is blurred by {:.2} px more than the map", values[0])
    },
    ..PLAIN
};
