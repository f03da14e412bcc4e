//! A pedestal of the frames that differs from the stated one.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN};

/// Least share of the light that is left. The light's own error dominates below.
const MIN_LIGHT_SHARE: f32 = 0.05;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::BlackLevel,
    equation: "x = ln(L - b)",
    source: "Sony IMX708 and libcamera: SensorBlackLevels",
    stage: CandidateStage::Light,
    // In digital units, as a manifest states it. A pedestal below the stated one has the law of a
    // dark current.
    parameters: &[CandidateParameter::linear("offset_dn", [0.0, 200.0], 0.3)],
    starting_points: |evidence| {
        let white = evidence.facts.white_dn;
        vec![vec![0.01 * white], vec![0.04 * white]]
    },
    apply: |values, _, view| {
        let facts = &view.evidence.facts;
        let offset = (values[0] * facts.light_per_pedestal / facts.white_dn).min(0.9) as f32;
        for signal in &mut view.signal {
            // In the dark the light's own error dominates; single pixels must not outweigh all
            // others.
            let light = signal.exp();
            *signal = ((light - offset).max(MIN_LIGHT_SHARE * light) / (1.0 - offset)).ln();
        }
    },
    competing: &[EffectId::DarkCurrent, EffectId::ToneCurve],
    separating_recording: "dark frames with the lens cap on",
    describe: |values| {
        format!("the black level of the frames is {:.1} DN above the stated one", values[0])
    },
    ..PLAIN
};
