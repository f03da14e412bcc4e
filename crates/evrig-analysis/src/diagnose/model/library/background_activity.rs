//! Events that come at random.

use super::{Candidate, EffectId, Freed, Nuisance, PLAIN};

const MOST: f64 = 6.0;

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::BackgroundActivity,
    equation: "events at rate b, independent of light and past",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008",
    frees: &[
        Freed { nuisance: Nuisance::LogBackgroundOn, range: [-9.0, MOST] },
        Freed { nuisance: Nuisance::LogBackgroundOff, range: [-9.0, MOST] },
        // What is added to events behind the pixel, it does not memorise.
        Freed { nuisance: Nuisance::BackgroundMemorised, range: [0.0, 1.0] },
    ],
    starts: |_| {
        let rates = [(0.2_f64, 1.0), (1.0, 1.0), (5.0, 1.0), (0.2, 0.0), (1.0, 0.0), (5.0, 0.0)];
        rates.iter().map(|(hz, memorised)| vec![hz.ln(), hz.ln(), *memorised]).collect()
    },
    report: |values| {
        let hz = |nuisance: Nuisance| values[nuisance as usize].exp();
        vec![hz(Nuisance::LogBackgroundOn) + hz(Nuisance::LogBackgroundOff)]
    },
    rivals: &[EffectId::ShotNoise, EffectId::JunctionLeak, EffectId::HotPixels],
    splitter: "a static segment: noise alternates in polarity, background does not",
    says: |values| {
        format!("every pixel fires {:.2} times a second for no reason in the light", values[0])
    },
    ..PLAIN
};
