//! Time stamps with random errors.

use super::{CandidateEffect, CandidateParameter, EffectId, Nuisance, PLAIN, logs};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::StampJitter,
    equation: "t = t_event + s e, so var(r) = s^2 x'^2",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    parameters: &[CandidateParameter::log("sigma_us", [20.0, 50_000.0])],
    starting_points: |_| logs(&[300.0, 1_500.0, 6_000.0]),
    // Threshold noise scatters events in time as well.
    nuisance_resets: &[(Nuisance::LogNoise, -3.5), (Nuisance::LogNoiseHz, 0.0)],
    apply: |values, _, view| {
        view.law.jitter_s = view.law.jitter_s.hypot(values[0] * 1e-6);
        view.law.corrects_stamps = true;
    },
    competing: &[EffectId::ShotNoise, EffectId::FrameNoise],
    separating_recording: "two speeds: stamp jitter is constant in time, threshold noise is \
         constant in contrast",
    describe: |values| format!("time stamps have a jitter of {:.0} us", values[0]),
    ..PLAIN
};
