//! Vibration of the arm.

use super::sinusoid::amplitude;
use super::{LibraryEffect, ModelTerm, PLAIN, linear, needs_surroundings};
use crate::diagnose::ConfidenceInterval;
use crate::diagnose::evidence::spectral_lines::lines;
use evrig_core::effect_id::EffectId;
use std::f64::consts::TAU;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::Vibration,
    equation: "u = u_path + (a, b) sin(2 pi f t + p)",
    source: "Dobot Magician: stepper motors with belts",
    term: Some(&TERM),
    competing: &[EffectId::Flicker, EffectId::Misregistration],
    separating_recording: "a static segment: vibration stops with the motors, flicker remains",
    requires: needs_surroundings,
    describe: |values| format!("the head vibrates at {:.1} Hz", values[0]),
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::Vibration,
    parameters: &[
        linear("frequency_hz", [1.0, 500.0], 2e-3),
        linear("sine_x_px", [-2.0, 2.0], 2e-3),
        linear("cosine_x_px", [-2.0, 2.0], 2e-3),
        linear("sine_y_px", [-2.0, 2.0], 2e-3),
        linear("cosine_y_px", [-2.0, 2.0], 2e-3),
    ],
    changes_signal: true,
    ordinary: |_| [0.0; 2],
    starts: |e| {
        if !e.facts.from_scene {
            return vec![];
        }
        lines(e, 1)
            .into_iter()
            .flat_map(|hz| {
                (0..4).map(move |k| {
                    let p = f64::from(k) * TAU / 4.0;
                    vec![hz, 0.1 * p.cos(), 0.1 * p.sin(), 0.1 * p.cos(), 0.1 * p.sin()]
                })
            })
            .collect()
    },
    stage: 0,
    apply: |v, view| {
        let turn = TAU * v[0] * view.step_us * 1e-6;
        let n = view.signal.len();
        let pixel = view.pixel;
        if pixel.gradient[0].is_empty() {
            return;
        }
        for (i, signal) in view.signal.iter_mut().enumerate() {
            let phase = turn * (i as f64 - 0.5 * n as f64);
            let (s, c) = phase.sin_cos();
            *signal += (v[1] * s + v[2] * c) * f64::from(pixel.gradient[0][i])
                + (v[3] * s + v[4] * c) * f64::from(pixel.gradient[1][i]);
        }
    },
    report: |evidence, all| {
        let px = amplitude(amplitude(all[1].1, all[2].1), amplitude(all[3].1, all[4].1));
        let mm = evidence.facts.pixel_mm.map(|mm| {
            let scaled = px.ci90.map(|end| end.map(|end| end * mm));
            ("amplitude_mm", ConfidenceInterval { value: px.value * mm, ci90: scaled })
        });
        std::iter::once(all[0]).chain(mm).collect()
    },
};
