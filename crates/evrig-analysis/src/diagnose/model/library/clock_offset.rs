//! A clock offset that differs from the stated one.

use super::{CandidateEffect, EffectId, FreedNuisance, Nuisance, PLAIN};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::ClockOffset,
    equation: "t_DAVIS = t + d",
    source: "clock map of the session",
    freed: &[FreedNuisance { nuisance: Nuisance::OffsetUs, range: [-120_000.0, 120_000.0] }],
    starting_points: |evidence| {
        // With the camera's own frames on time, a delay of its events is a pixel latency.
        match evidence.facts.clock_tie {
            Some(tied) if tied.is_off() => return vec![vec![tied.offset_us[0]]],
            Some(_) => return Vec::new(),
            None => {}
        }
        // A start that is milliseconds off lies in another local maximum.
        let near = [2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 60.0];
        let far = [70.0, 80.0, 90.0, 100.0, 110.0];
        let ms = near.iter().chain(&far).flat_map(|ms| [*ms, -*ms]);
        ms.map(|ms| vec![ms * 1e3]).collect()
    },
    report_freed: |values| vec![values[Nuisance::OffsetUs as usize]],
    competing: &[
        EffectId::FixedPole,
        EffectId::PhotoreceptorBandwidth,
        EffectId::RollingShutter,
        EffectId::Misregistration,
    ],
    // A constant delay is one number wherever it arises, unless the camera's own frames show
    // whether they are delayed too.
    inseparable: &[EffectId::PixelLatency],
    reference_error: |evidence| evidence.facts.clock_error_us()[0],
    separating_recording: "a flash that both cameras see",
    describe: |values| {
        let way = if values[0] > 0.0 { "late" } else { "early" };
        format!(
            "the event camera's stamps are {:.0} us {way} relative to the light",
            values[0].abs()
        )
    },
    ..PLAIN
};
