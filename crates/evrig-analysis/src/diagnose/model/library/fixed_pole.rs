//! A pole behind the photoreceptor with constant bandwidth.

use super::photoreceptor_bandwidth::{FirstOrderPole, filter};
use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, logs};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::FixedPole,
    equation: "tau y' = x - y, 1 / (2 pi tau) = f",
    source: "Graca and Delbruck, arXiv 2109.08640 (source follower)",
    stage: CandidateStage::Receptor,
    parameters: &[CandidateParameter::log("cutoff_hz", [0.5, 3_000.0])],
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
    separating_recording: "a faster pass: a pole also attenuates fast changes, a clock offset \
         does not",
    describe: |values| {
        format!("the pixel's bandwidth is {:.0} Hz, independent of intensity", values[0])
    },
    ..PLAIN
};
