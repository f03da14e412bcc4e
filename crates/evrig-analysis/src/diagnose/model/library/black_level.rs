//! A pedestal of the frames that is not the stated one.

use super::{CandidateEffect, EffectId, EffectParameter, PLAIN, SignalStage};

/// Least share of the light that is left. The light's own error dominates below.
const MIN_LIGHT_SHARE: f32 = 0.05;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::BlackLevel,
    equation: "x = ln(L - b)",
    source: "Sony IMX708 and libcamera: SensorBlackLevels",
    stage: SignalStage::Light,
    // As a share of white inside the fit would be simpler; digital units are what a manifest states.
    // One that reads less than stated has the law of a dark current, and is its twin.
    parameters: &[EffectParameter::linear("offset_dn", [0.0, 200.0], 0.3)],
    starting_points: |evidence| {
        let white = evidence.facts.white_dn;
        vec![vec![0.01 * white], vec![0.04 * white]]
    },
    apply: |values, _, view| {
        let facts = &view.evidence.facts;
        let offset = (values[0] * facts.light_per_pedestal / facts.white_dn).min(0.9) as f32;
        for signal in &mut view.signal {
            // Where next to nothing would be left, the light's own error decides what is: a pixel or
            // two in the dark must not outweigh all others.
            let light = signal.exp();
            *signal = ((light - offset).max(MIN_LIGHT_SHARE * light) / (1.0 - offset)).ln();
        }
    },
    competing: &[EffectId::DarkCurrent, EffectId::ToneCurve],
    separating_recording: "frames with the lens cap on read the pedestal itself",
    describe: |values| {
        format!("without light the frames read {:.1} DN more than the session states", values[0])
    },
    ..PLAIN
};
