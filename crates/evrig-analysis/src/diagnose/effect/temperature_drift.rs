//! A leak that grows as the chip warms up.

use super::{LibraryEffect, ModelTerm, PLAIN, linear, needs_span};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::TemperatureDrift,
    equation: "dV = r t theta dt",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    term: Some(&TERM),
    competing: &[EffectId::JunctionLeak, EffectId::ClockSkew],
    separating_recording: "static segments at the start and at the end of a long recording",
    requires: |evidence| needs_span(evidence, 2.0),
    describe: |values| format!("the leak grows by {:.2} events per second every second", values[0]),
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::TemperatureDrift,
    parameters: &[linear("rate_hz_per_s", [-5.0, 20.0], 5e-3)],
    changes_signal: true,
    ordinary: |_| [0.0; 2],
    starts: |_| vec![vec![0.1], vec![-0.1]],
    stage: 2,
    apply: |v, view| {
        let half = 0.5 * v[0] * view.law.theta[0];
        let step = view.step_us * 1e-6;
        for (i, signal) in view.signal.iter_mut().enumerate() {
            let t = i as f64 * step;
            *signal += half * t * t;
        }
    },
    report: |_, all| all,
};
