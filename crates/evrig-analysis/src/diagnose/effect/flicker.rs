//! Periodic light.

use super::sinusoid::amplitude;
use super::{LibraryEffect, ModelTerm, PLAIN, linear, needs_span};
use crate::diagnose::evidence::spectral_lines::lines;
use evrig_core::effect_id::EffectId;
use std::f64::consts::TAU;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::Flicker,
    equation: "L (1 + m sin(2 pi f t + p))",
    source: "IEEE Std 1789-2015",
    term: Some(&TERM),
    competing: &[EffectId::Vibration, EffectId::ApsCoupling],
    separating_recording: "a static segment: flicker remains, vibration does not; and one with \
         the camera's frames off",
    requires: |evidence| needs_span(evidence, 0.5),
    describe: |values| {
        format!(
            "the light flickers at {:.1} Hz with a depth of {:.0} %",
            values[0],
            values[1] * 100.0
        )
    },
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::Flicker,
    parameters: &[
        linear("frequency_hz", [1.0, 500.0], 2e-3),
        linear("sine", [-0.9, 0.9], 1e-3),
        linear("cosine", [-0.9, 0.9], 1e-3),
    ],
    changes_signal: true,
    ordinary: |_| [0.0; 2],
    starts: |e| {
        lines(e, 3)
            .into_iter()
            .flat_map(|hz| {
                (0..4).map(move |k| {
                    let p = f64::from(k) * TAU / 4.0;
                    vec![hz, 0.01 * p.cos(), 0.01 * p.sin()]
                })
            })
            .collect()
    },
    stage: 0,
    apply: |v, view| {
        let turn = TAU * v[0] * view.step_us * 1e-6;
        let n = view.signal.len();
        for (i, signal) in view.signal.iter_mut().enumerate() {
            let phase = turn * (i as f64 - 0.5 * n as f64);
            *signal += (1.0 + (v[1] * phase.sin() + v[2] * phase.cos()).max(-0.999)).ln();
        }
    },
    report: |_, all| vec![all[0], ("depth", amplitude(all[1].1, all[2].1))],
};
