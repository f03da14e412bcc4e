//! Leak proportional to light.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, needs_span};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::PhotocurrentLeak,
    equation: "dV = r theta L / L_white dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    stage: CandidateStage::Drift,
    parameters: &[CandidateParameter::linear("rate_hz_at_white", [-2.0, 60.0], 0.05)],
    starting_points: |_| vec![vec![0.3], vec![1.0], vec![4.0]],
    apply: |values, _, view| {
        let step = values[0] * view.law.theta_on * view.step_s();
        let mut drift = 0.0;
        for (signal, level) in view.signal.iter_mut().zip(&view.pixel.light) {
            *signal += drift as f32;
            drift += if level.is_finite() { step * f64::from(level.exp()) } else { 0.0 };
        }
    },
    competing: &[EffectId::JunctionLeak, EffectId::ThresholdAsymmetry],
    separating_recording: "a static segment at two levels of light",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| {
        format!(
            "white pixels drift towards ON by {:.2} thresholds per second, others in proportion \
             to their light",
            values[0]
        )
    },
    ..PLAIN
};
