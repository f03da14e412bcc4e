//! Random events.

use super::{CandidateEffect, EffectId, FreedNuisance, Nuisance, PLAIN};

const MAX_LOG_RATE_HZ: f64 = 6.0;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::BackgroundActivity,
    equation: "events at rate b, independent of light and past",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008",
    freed: &[
        FreedNuisance { nuisance: Nuisance::LogBackgroundOn, range: [-9.0, MAX_LOG_RATE_HZ] },
        FreedNuisance { nuisance: Nuisance::LogBackgroundOff, range: [-9.0, MAX_LOG_RATE_HZ] },
        // Events added behind the pixel do not reset its reference level.
        FreedNuisance { nuisance: Nuisance::BackgroundResetsReference, range: [0.0, 1.0] },
    ],
    starting_points: |_| {
        let rates = [(0.2_f64, 1.0), (1.0, 1.0), (5.0, 1.0), (0.2, 0.0), (1.0, 0.0), (5.0, 0.0)];
        rates.iter().map(|(hz, memorised)| vec![hz.ln(), hz.ln(), *memorised]).collect()
    },
    report_freed: |values| {
        let hz = |nuisance: Nuisance| values[nuisance as usize].exp();
        vec![hz(Nuisance::LogBackgroundOn) + hz(Nuisance::LogBackgroundOff)]
    },
    competing: &[EffectId::ShotNoise, EffectId::JunctionLeak, EffectId::HotPixels],
    separating_recording: "a static segment: noise alternates in polarity, background does not",
    describe: |values| format!("every pixel has {:.2} background events per second", values[0]),
    ..PLAIN
};
