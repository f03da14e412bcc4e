//! Leak that does not depend on light.

use super::{CandidateEffect, EffectId, FreedNuisance, Nuisance, PLAIN, needs_span};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::JunctionLeak,
    equation: "dV = r theta dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    freed: &[FreedNuisance { nuisance: Nuisance::LeakHz, range: [-2.0, 60.0] }],
    starting_points: |_| vec![vec![0.6], vec![2.0], vec![6.0]],
    report_freed: |values| vec![values[Nuisance::LeakHz as usize]],
    competing: &[
        EffectId::PhotocurrentLeak,
        EffectId::BackgroundActivity,
        EffectId::ThresholdAsymmetry,
    ],
    separating_recording: "a static segment in the dark: there a junction's leak stays and a photocurrent's goes",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| {
        format!(
            "every pixel drifts towards On by {:.2} thresholds a second, in any light",
            values[0]
        )
    },
    ..PLAIN
};
