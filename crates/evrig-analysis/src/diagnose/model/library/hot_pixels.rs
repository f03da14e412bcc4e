//! Pixels with a high background rate.

use super::{CandidateEffect, CandidateParameter, EffectId, PLAIN, PixelMixture};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::HotPixels,
    equation: "a share h of the pixels fires at rate b",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    parameters: &[
        CandidateParameter::log("fraction", [1e-4, 0.3]),
        CandidateParameter::log("rate_hz", [1.0, 3_000.0]).hidden(),
    ],
    starting_points: |_| {
        [10.0_f64, 60.0, 300.0].iter().map(|hz| vec![0.02_f64.ln(), hz.ln()]).collect()
    },
    mixture: Some(|hypothesis, index| PixelMixture::two_strata(hypothesis.parameters_of(index)[0])),
    apply: |values, stratum, view| {
        if stratum[0] > 0.5 {
            view.law.background_on_hz += 0.5 * values[1];
            view.law.background_off_hz += 0.5 * values[1];
        }
    },
    competing: &[EffectId::BackgroundActivity, EffectId::ThresholdMismatch],
    separating_recording: "a static segment: hot pixels fire there too",
    describe: |values| format!("{:.2} % of the pixels fire by themselves", values[0] * 100.0),
    ..PLAIN
};
