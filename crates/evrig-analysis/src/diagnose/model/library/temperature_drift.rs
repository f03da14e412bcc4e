//! A leak that grows while the chip warms.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, needs_span};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::TemperatureDrift,
    equation: "dV = r t theta dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    stage: Stage::Drift,
    parameters: &[Parameter::linear("rate_hz_per_s", [-5.0, 20.0], 0.02)],
    starts: |_| vec![vec![0.1], vec![0.5], vec![2.0]],
    act: |values, _, view| {
        let half = 0.5 * values[0] * view.law.theta_on;
        let step = view.step_s();
        for (i, signal) in view.signal.iter_mut().enumerate() {
            let t = i as f64 * step;
            *signal += (half * t * t) as f32;
        }
    },
    rivals: &[EffectId::JunctionLeak, EffectId::ClockSkew],
    splitter: "static segments at the start and at the end of a long recording",
    needs: |evidence| needs_span(evidence, 2.0),
    says: |values| format!("the leak grows by {:.2} events a second in every second", values[0]),
    ..PLAIN
};
