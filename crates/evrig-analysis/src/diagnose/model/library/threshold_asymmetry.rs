//! On and Off thresholds that differ.

use super::{Candidate, EffectId, Freed, Nuisance, PLAIN};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ThresholdAsymmetry,
    equation: "theta_on = q theta_off",
    source: "Wang et al., arXiv 2012.09378",
    frees: &[Freed { nuisance: Nuisance::LogRatio, range: [-1.6, 1.6] }],
    starts: |_| vec![vec![0.1], vec![-0.1], vec![0.5], vec![-0.5]],
    report: |values| vec![values[Nuisance::LogRatio as usize].exp()],
    rivals: &[EffectId::JunctionLeak, EffectId::PhotocurrentLeak],
    splitter: "two speeds: an asymmetry is the same per cycle, a leak per second",
    says: |values| format!("an On event takes {:.2} times the contrast of an Off event", values[0]),
    ..PLAIN
};
