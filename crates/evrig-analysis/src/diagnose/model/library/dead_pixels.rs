//! Pixels that never fire.

use super::{Candidate, EffectId, Mixture, PLAIN, Parameter};

/// A threshold that no light reaches, in log intensity.
const NEVER: f64 = 200.0;

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::DeadPixels,
    equation: "a share of the pixels has no events",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    // The share is what the likelihood knows; the count on the sensor follows from it.
    parameters: &[Parameter::log("fraction", [1e-4, 0.5]).hidden()],
    starts: |_| vec![vec![0.02_f64.ln()]],
    mixture: Some(|hypothesis, index| Mixture::of_two(hypothesis.parameters_of(index)[0])),
    act: |_, kind, view| {
        if kind[0] > 0.5 {
            view.law.theta_on = NEVER;
            view.law.theta_off = NEVER;
            view.law.leak_per_s = 0.0;
            view.law.background_on_hz = 1e-6;
            view.law.background_off_hz = 1e-6;
            view.law.noise_speed_per_s = 0.0;
        }
    },
    derived: |evidence, values| vec![("count", (values[0] * evidence.n_sensor()).round())],
    rivals: &[EffectId::ThresholdMismatch],
    is_silent: true,
    splitter: "a faster pass with more contrast",
    says: |values| format!("{:.2} % of the pixels never fire", values[0] * 100.0),
    ..PLAIN
};
