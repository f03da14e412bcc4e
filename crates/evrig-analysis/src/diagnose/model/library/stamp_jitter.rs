//! Stamps that scatter about the instant of the event.

use super::{CandidateEffect, EffectId, EffectParameter, Nuisance, PLAIN, logs};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::StampJitter,
    equation: "t = t_event + s e, so var(r) = s^2 x'^2",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    parameters: &[EffectParameter::log("sigma_us", [20.0, 50_000.0])],
    starting_points: |_| logs(&[300.0, 1_500.0, 6_000.0]),
    // Noise of the comparison scatters events as well, by the slope of the light more or less.
    nuisance_resets: &[(Nuisance::LogNoise, -3.5), (Nuisance::LogNoiseHz, 0.0)],
    apply: |values, _, view| {
        view.law.jitter_s = view.law.jitter_s.hypot(values[0] * 1e-6);
        view.law.corrects_stamps = true;
    },
    competing: &[EffectId::ShotNoise, EffectId::FrameNoise],
    separating_recording: "two speeds: scatter in time grows with the slope of the light, scatter of thresholds does not",
    describe: |values| format!("stamps scatter by {:.0} us", values[0]),
    ..PLAIN
};
