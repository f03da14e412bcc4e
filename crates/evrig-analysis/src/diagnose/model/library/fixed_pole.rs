//! A pole behind the photoreceptor that does not depend on light.

use super::photoreceptor_bandwidth::{FirstOrderPole, filter};
use super::{CandidateEffect, EffectId, EffectParameter, PLAIN, SignalStage, logs};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::FixedPole,
    equation: "tau y' = x - y, 1 / (2 pi tau) = f",
    source: "Graca and Delbruck, arXiv 2109.08640 (source follower)",
    stage: SignalStage::Receptor,
    parameters: &[EffectParameter::log("cutoff_hz", [0.5, 3_000.0])],
    starting_points: |_| logs(&[5.0, 15.0, 50.0, 150.0, 500.0]),
    apply: |values, _, view| {
        let pole = FirstOrderPole::new(values[0], view.step_s());
        filter(view, |_| pole);
    },
    competing: &[
        EffectId::PhotoreceptorBandwidth,
        EffectId::ClockOffset,
        EffectId::PixelLatency,
        EffectId::Defocus,
    ],
    separating_recording: "a faster pass: a pole also weakens what is fast, an offset of the clock does not",
    describe: |values| {
        format!(
            "the pixel follows light only up to {:.0} Hz, in bright and in dark alike",
            values[0]
        )
    },
    ..PLAIN
};
