//! From the crossing to the request: events are late, the camera's own frames are not.

use super::{CandidateEffect, EffectId, FreedNuisance, Nuisance, PLAIN};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::PixelLatency,
    equation: "t = t_cross + t_latency",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    freed: &[FreedNuisance { nuisance: Nuisance::OffsetUs, range: [0.0, 120_000.0] }],
    starting_points: |evidence| match evidence.facts.clock_tie {
        Some(tied) if !tied.is_off() => {
            [2.0, 5.0, 10.0, 20.0, 40.0].iter().map(|ms| vec![ms * 1e3]).collect()
        }
        _ => Vec::new(),
    },
    report_freed: |values| vec![values[Nuisance::OffsetUs as usize]],
    competing: &[EffectId::FixedPole, EffectId::PhotoreceptorBandwidth, EffectId::ClockOffset],
    separating_recording: "a light step: a latency moves its events, a pole spreads them",
    requires: |evidence| match evidence.facts.clock_tie {
        Some(_) => Ok(()),
        None => Err("nothing ties the events' clock to the light's but the events themselves: a \
                     late clock and a late pixel are one number"
            .into()),
    },
    describe: |values| {
        format!("events come {:.0} us behind their crossing; the frames are on time", values[0])
    },
    ..PLAIN
};
