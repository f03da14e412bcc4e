//! A leak that grows as the chip warms up.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, needs_span};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::TemperatureDrift,
    equation: "dV = r t theta dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    stage: CandidateStage::Drift,
    parameters: &[CandidateParameter::linear("rate_hz_per_s", [-5.0, 20.0], 0.02)],
    starting_points: |_| vec![vec![0.1], vec![0.5], vec![2.0]],
    apply: |values, _, view| {
        let half = 0.5 * values[0] * view.law.theta_on;
        let step = view.step_s();
        for (i, signal) in view.signal.iter_mut().enumerate() {
            let t = i as f64 * step;
            *signal += (half * t * t) as f32;
        }
    },
    competing: &[EffectId::JunctionLeak, EffectId::ClockSkew],
    separating_recording: "static segments at the start and at the end of a long recording",
    requires: |evidence| needs_span(evidence, 2.0),
    describe: |values| format!("the leak grows by {:.2} events per second every second", values[0]),
    ..PLAIN
};
