//! ON and OFF thresholds that differ.

use super::{CandidateEffect, EffectId, FreedNuisance, Nuisance, PLAIN};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::ThresholdAsymmetry,
    equation: "theta_on = q theta_off",
    source: "Wang et al., arXiv 2012.09378",
    freed: &[FreedNuisance { nuisance: Nuisance::LogRatio, range: [-1.6, 1.6] }],
    starting_points: |_| vec![vec![0.1], vec![-0.1], vec![0.5], vec![-0.5]],
    report_freed: |values| vec![values[Nuisance::LogRatio as usize].exp()],
    competing: &[EffectId::JunctionLeak, EffectId::PhotocurrentLeak],
    separating_recording: "two speeds: an asymmetry is the same per cycle, a leak per second",
    describe: |values| {
        format!("an ON event takes {:.2} times the contrast of an OFF event", values[0])
    },
    ..PLAIN
};
