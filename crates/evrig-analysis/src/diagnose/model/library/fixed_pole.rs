//! A pole behind the photoreceptor that does not depend on light.

use super::photoreceptor_bandwidth::{Pole, filter};
use super::{Candidate, EffectId, PLAIN, Parameter, Stage, logs};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::FixedPole,
    equation: "tau y' = x - y, 1 / (2 pi tau) = f",
    source: "Graca and Delbruck, arXiv 2109.08640 (source follower)",
    stage: Stage::Receptor,
    parameters: &[Parameter::log("cutoff_hz", [0.5, 3_000.0])],
    starts: |_| logs(&[5.0, 15.0, 50.0, 150.0, 500.0]),
    act: |values, _, view| {
        let pole = Pole::new(values[0], view.step_s());
        filter(view, |_| pole);
    },
    rivals: &[
        EffectId::PhotoreceptorBandwidth,
        EffectId::ClockOffset,
        EffectId::PixelLatency,
        EffectId::Defocus,
    ],
    splitter: "a faster pass: a pole also weakens what is fast, an offset of the clock does not",
    says: |values| {
        format!(
            "the pixel follows light only up to {:.0} Hz, in bright and in dark alike",
            values[0]
        )
    },
    ..PLAIN
};
