//! A pedestal of the frames that is not the stated one.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::BlackLevel,
    equation: "x = ln(L - b)",
    source: "Sony IMX708 and libcamera: SensorBlackLevels",
    stage: Stage::Light,
    // As a share of white inside the fit would be simpler; digital units are what a manifest states.
    parameters: &[Parameter::linear("offset_dn", [-200.0, 200.0], 0.3)],
    starts: |evidence| {
        let white = evidence.facts.white_dn;
        vec![vec![0.01 * white], vec![0.04 * white], vec![-0.03 * white]]
    },
    act: |values, _, view| {
        let offset = (values[0] / view.evidence.facts.white_dn).min(0.9) as f32;
        for signal in &mut view.signal {
            // A tenth of a percent of white is the darkest that still has a logarithm.
            *signal = ((signal.exp() - offset) / (1.0 - offset)).max(1e-3).ln();
        }
    },
    rivals: &[EffectId::DarkCurrent, EffectId::ToneCurve],
    splitter: "frames with the lens cap on read the pedestal itself",
    says: |values| {
        format!("without light the frames read {:.1} DN more than the session states", values[0])
    },
    ..PLAIN
};
