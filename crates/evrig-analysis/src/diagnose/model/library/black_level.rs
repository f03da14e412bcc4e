//! A pedestal of the frames that is not the stated one.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage};

/// Share of the light that a pedestal leaves at least.
const LEAST_LEFT: f32 = 0.05;

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::BlackLevel,
    equation: "x = ln(L - b)",
    source: "Sony IMX708 and libcamera: SensorBlackLevels",
    stage: Stage::Light,
    // As a share of white inside the fit would be simpler; digital units are what a manifest states.
    // One that reads less than stated has the law of a dark current, and is its twin.
    parameters: &[Parameter::linear("offset_dn", [0.0, 200.0], 0.3)],
    starts: |evidence| {
        let white = evidence.facts.white_dn;
        vec![vec![0.01 * white], vec![0.04 * white]]
    },
    act: |values, _, view| {
        let facts = &view.evidence.facts;
        let offset = (values[0] * facts.light_per_pedestal / facts.white_dn).min(0.9) as f32;
        for signal in &mut view.signal {
            // Where next to nothing would be left, the light's own error decides what is: a pixel or
            // two in the dark must not outweigh all others.
            let light = signal.exp();
            *signal = ((light - offset).max(LEAST_LEFT * light) / (1.0 - offset)).ln();
        }
    },
    rivals: &[EffectId::DarkCurrent, EffectId::ToneCurve],
    splitter: "frames with the lens cap on read the pedestal itself",
    says: |values| {
        format!("without light the frames read {:.1} DN more than the session states", values[0])
    },
    ..PLAIN
};
