//! Leak independent of light.

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
    separating_recording: "a static segment in the dark: a junction leak remains there, a \
         photocurrent leak does not",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| {
        format!(
            "every pixel drifts towards ON by {:.2} thresholds per second, independent of light",
            values[0]
        )
    },
    ..PLAIN
};
