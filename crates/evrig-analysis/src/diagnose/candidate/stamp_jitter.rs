//! Stamps that scatter about the instant of the event.

use super::{Candidate, EffectId, Nuisance, PLAIN, Parameter, logs};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::StampJitter,
    equation: "t = t_event + s e, so var(r) = s^2 x'^2",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    parameters: &[Parameter::log("sigma_us", [20.0, 50_000.0])],
    starts: |_| logs(&[300.0, 1_500.0, 6_000.0]),
    // Noise of the comparison scatters events as well, by the slope of the light more or less.
    stand_ins: &[(Nuisance::LogNoise, -3.5), (Nuisance::LogNoiseHz, 0.0)],
    act: |values, _, view| {
        view.law.jitter_s = view.law.jitter_s.hypot(values[0] * 1e-6);
        view.law.corrects_stamps = true;
    },
    rivals: &[EffectId::ShotNoise, EffectId::FrameNoise],
    splitter: "two speeds: scatter in time grows with the slope of the light, scatter of thresholds does not",
    says: |values| format!("stamps scatter by {:.0} us", values[0]),
    ..PLAIN
};
