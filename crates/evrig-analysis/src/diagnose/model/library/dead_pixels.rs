//! Pixels that never fire.

use super::{CandidateEffect, CandidateParameter, EffectId, PLAIN, PixelMixture};

/// Threshold in log intensity that no signal reaches.
const UNREACHABLE_THRESHOLD: f64 = 200.0;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::DeadPixels,
    equation: "a share of the pixels has no events",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    // The likelihood depends on the share; the count on the sensor is derived.
    parameters: &[CandidateParameter::log("fraction", [1e-4, 0.5]).hidden()],
    starting_points: |_| vec![vec![0.02_f64.ln()]],
    mixture: Some(|hypothesis, index| PixelMixture::two_strata(hypothesis.parameters_of(index)[0])),
    apply: |_, stratum, view| {
        if stratum[0] > 0.5 {
            view.law.theta_on = UNREACHABLE_THRESHOLD;
            view.law.theta_off = UNREACHABLE_THRESHOLD;
            view.law.leak_per_s = 0.0;
            view.law.background_on_hz = 1e-6;
            view.law.background_off_hz = 1e-6;
            view.law.noise_speed_per_s = 0.0;
        }
    },
    derived: |evidence, values| vec![("count", (values[0] * evidence.n_sensor()).round())],
    competing: &[EffectId::ThresholdMismatch],
    acts_on_silent_pixels: true,
    separating_recording: "a faster pass with more contrast",
    describe: |values| format!("{:.2} % of the pixels never fire", values[0] * 100.0),
    ..PLAIN
};
