//! Periodic light.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, needs_span};
use crate::diagnose::evidence::spectral_lines;
use std::f64::consts::TAU;

/// Least share of the light at the trough.
const MIN_LIGHT_SHARE: f64 = 1e-3;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::Flicker,
    equation: "L (1 + m sin(2 pi f t + p))",
    source: "IEEE Std 1789-2015",
    stage: CandidateStage::Light,
    parameters: &[
        CandidateParameter::linear("frequency_hz", [1.0, 500.0], 0.005),
        CandidateParameter::log("depth", [1e-3, 0.95]),
        CandidateParameter::linear("phase", [-20.0, 20.0], 0.05).hidden(),
    ],
    starting_points: |evidence| {
        spectral_lines::lines(evidence, 4)
            .into_iter()
            .flat_map(|hz| {
                (0..6).map(move |turn| vec![hz, 0.05_f64.ln(), f64::from(turn) * TAU / 6.0])
            })
            .collect()
    },
    apply: |values, _, view| {
        let swing = view.swing(values[0], values[2]);
        for (signal, swing) in view.signal.iter_mut().zip(swing) {
            *signal += (1.0 + (values[1] * swing).max(MIN_LIGHT_SHARE - 1.0)).ln() as f32;
        }
    },
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
