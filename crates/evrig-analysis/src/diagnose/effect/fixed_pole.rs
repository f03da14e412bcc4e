//! A pole behind the photoreceptor with constant bandwidth.

use super::low_pass::{SignalPole, fastest_hz, filter};
use super::{LibraryEffect, ModelTerm, PLAIN, log};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::FixedPole,
    equation: "tau y' = x - y, 1 / (2 pi tau) = f",
    source: "Graca and Delbruck, arXiv 2109.08640 (source follower)",
    term: Some(&TERM),
    competing: &[
        EffectId::PhotoreceptorBandwidth,
        EffectId::ClockOffset,
        EffectId::PixelLatency,
        EffectId::Defocus,
    ],
    separating_recording: "a faster pass: a pole also attenuates fast changes, a clock offset \
         does not",
    describe: |values| {
        format!("the pixel's bandwidth is {:.0} Hz, independent of intensity", values[0])
    },
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::FixedPole,
    parameters: &[log("cutoff_hz", [0.5, 3_000.0])],
    changes_signal: true,
    ordinary: |evidence| [fastest_hz(evidence, 1.0), f64::INFINITY],
    starts: |_| [10.0, 60.0, 400.0].iter().map(|s| vec![*s]).collect(),
    stage: 1,
    apply: |v, view| {
        let pole = SignalPole::new(v[0], view.step_us * 1e-6);
        filter(view, |_| pole);
    },
    report: |_, all| all,
};
