//! Vibration of the arm.

use super::{
    CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, needs_surroundings,
};
use crate::diagnose::evidence::spectral_lines;
use std::f64::consts::TAU;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::Vibration,
    equation: "u = u_path + (a, b) sin(2 pi f t + p)",
    source: "Dobot Magician: stepper motors with belts",
    stage: CandidateStage::Light,
    parameters: &[
        CandidateParameter::linear("frequency_hz", [1.0, 500.0], 0.005),
        CandidateParameter::linear("amplitude_x_px", [-2.0, 2.0], 0.01).hidden(),
        CandidateParameter::linear("amplitude_y_px", [-2.0, 2.0], 0.01).hidden(),
        CandidateParameter::linear("phase", [-20.0, 20.0], 0.05).hidden(),
    ],
    starting_points: |evidence| {
        spectral_lines::lines(evidence, 1)
            .into_iter()
            .flat_map(|hz| {
                (0..4).flat_map(move |turn| {
                    let phase = f64::from(turn) * TAU / 4.0;
                    [vec![hz, 0.2, 0.0, phase], vec![hz, 0.0, 0.2, phase]]
                })
            })
            .collect()
    },
    apply: |values, _, view| {
        let swing = view.swing(values[0], values[3]);
        let [gx, gy] = &view.pixel.gradient;
        for (((signal, gx), gy), swing) in view.signal.iter_mut().zip(gx).zip(gy).zip(swing) {
            *signal += (swing * (values[1] * f64::from(*gx) + values[2] * f64::from(*gy))) as f32;
        }
    },
    derived: |evidence, values| {
        let px = values[1].hypot(values[2]);
        evidence.facts.pixel_mm.map(|mm| ("amplitude_mm", px * mm)).into_iter().collect()
    },
    competing: &[EffectId::Flicker, EffectId::Misregistration],
    separating_recording: "a static segment: vibration stops with the motors, flicker remains",
    requires: needs_surroundings,
    describe: |values| format!("the head vibrates at {:.1} Hz", values[0]),
    ..PLAIN
};
