//! Pixels that fire by themselves.

use super::{Candidate, EffectId, Mixture, PLAIN, Parameter};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::HotPixels,
    equation: "a share h of the pixels fires at rate b",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    parameters: &[
        Parameter::log("fraction", [1e-4, 0.3]),
        Parameter::log("rate_hz", [1.0, 3_000.0]).hidden(),
    ],
    starts: |_| [10.0_f64, 60.0, 300.0].iter().map(|hz| vec![0.02_f64.ln(), hz.ln()]).collect(),
    mixture: Some(|hypothesis, index| Mixture::of_two(hypothesis.parameters_of(index)[0])),
    act: |values, kind, view| {
        if kind[0] > 0.5 {
            view.law.background_on_hz += 0.5 * values[1];
            view.law.background_off_hz += 0.5 * values[1];
        }
    },
    rivals: &[EffectId::BackgroundActivity, EffectId::ThresholdMismatch],
    splitter: "a static segment: hot pixels fire there too",
    says: |values| format!("{:.2} % of the pixels fire by themselves", values[0] * 100.0),
    ..PLAIN
};
