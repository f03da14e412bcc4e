//! Photoreceptor bandwidth proportional to intensity.

use super::low_pass::{SignalPole, fastest_hz, filter};
use super::{LibraryEffect, ModelTerm, PLAIN, fixed, log};
use evrig_core::effect_id::EffectId;

/// Mean reflectance of a scene.
const GREY: f64 = 0.18;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::PhotoreceptorBandwidth,
    equation: "tau(L) y' = x - y, 1 / (2 pi tau) = f_white L / L_white (order times)",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008; \
             Graca and Delbruck, arXiv 2109.08640",
    term: Some(&TERM),
    competing: &[
        EffectId::FixedPole,
        EffectId::ClockOffset,
        EffectId::Defocus,
        EffectId::RefractoryPeriod,
    ],
    separating_recording: "the same path in five times less light: this cutoff falls with the \
         light, the others do not",
    describe: |values| {
        format!(
            "the photoreceptor's bandwidth is {:.0} Hz at white, proportional to intensity",
            values[0]
        )
    },
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::PhotoreceptorBandwidth,
    parameters: &[
        log("cutoff_hz_at_white", [0.5, 3_000.0]),
        fixed("order"),
        log("floor", [1e-3, 0.3]),
    ],
    changes_signal: true,
    ordinary: |evidence| [fastest_hz(evidence, GREY), f64::INFINITY],
    starts: |_| {
        [[20.0, 1.0, 0.01], [80.0, 1.0, 0.01], [400.0, 1.0, 0.01], [80.0, 2.0, 0.01]]
            .iter()
            .map(|s| s.to_vec())
            .collect()
    },
    stage: 1,
    apply: |v, view| {
        let (white, order, floor) = (v[0], v[1], v[2]);
        let step = view.step_us * 1e-6;
        for _ in 0..(order.round() as usize).clamp(1, 2) {
            filter(view, |level| {
                SignalPole::new(white * (f64::from(level).exp() + floor) / (1.0 + floor), step)
            });
        }
    },
    report: |_, all| all[..2].to_vec(),
};
