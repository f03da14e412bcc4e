//! Delay from threshold crossing to event; the camera's own frames are on time.

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
    separating_recording: "a light step: a latency shifts its events, a pole spreads them",
    requires: |evidence| match evidence.facts.clock_tie {
        Some(_) => Ok(()),
        None => Err("only the events themselves tie their clock to the light's: a clock offset \
             and a latency cannot be separated"
            .into()),
    },
    describe: |values| {
        format!(
            "events come {:.0} us after the threshold crossing; the frames are on time",
            values[0]
        )
    },
    ..PLAIN
};
