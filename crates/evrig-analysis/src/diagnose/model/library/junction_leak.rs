//! Leak that does not depend on light.

use super::{Candidate, EffectId, Freed, Nuisance, PLAIN, needs_span};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::JunctionLeak,
    equation: "dV = r theta dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    frees: &[Freed { nuisance: Nuisance::LeakHz, range: [-2.0, 60.0] }],
    starts: |_| vec![vec![0.6], vec![2.0], vec![6.0]],
    report: |values| vec![values[Nuisance::LeakHz as usize]],
    rivals: &[
        EffectId::PhotocurrentLeak,
        EffectId::BackgroundActivity,
        EffectId::ThresholdAsymmetry,
    ],
    splitter: "a static segment in the dark: there a junction's leak stays and a photocurrent's goes",
    needs: |evidence| needs_span(evidence, 1.0),
    says: |values| {
        format!(
            "every pixel drifts towards On by {:.2} thresholds a second, in any light",
            values[0]
        )
    },
    ..PLAIN
};
