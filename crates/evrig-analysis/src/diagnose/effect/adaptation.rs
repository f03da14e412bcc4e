//! Slow adaptation.

use super::{LibraryEffect, ModelTerm, PLAIN, linear, log, needs_span};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::Adaptation,
    equation: "y = x - a z, T z' = x - z",
    source: "Delbruck and Mead, Adaptive photoreceptor with wide dynamic range, ISCAS 1994",
    term: Some(&TERM),
    competing: &[EffectId::JunctionLeak, EffectId::TemperatureDrift],
    separating_recording: "a slower pass: adaptation grows with its duration",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| {
        format!(
            "the photoreceptor adapts to {:.0} % of a change within {:.2} s",
            values[1] * 100.0,
            values[0]
        )
    },
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::Adaptation,
    parameters: &[log("time_constant_s", [0.05, 20.0]), linear("fraction", [0.0, 0.98], 2e-3)],
    changes_signal: true,
    ordinary: |_| [0.0; 2],
    starts: |_| [[0.3, 0.05], [1.5, 0.05], [0.1, 0.05]].iter().map(|s| s.to_vec()).collect(),
    stage: 1,
    apply: |v, view| {
        let keep = (-view.step_us * 1e-6 / v[0]).exp();
        let mut slow: Option<f64> = None;
        for signal in &mut view.signal {
            let x = *signal;
            if !x.is_finite() {
                slow = None;
                continue;
            }
            let z = slow.map_or(x, |z| x + (z - x) * keep);
            slow = Some(z);
            *signal = x - v[1] * z;
        }
    },
    report: |_, all| all,
};
