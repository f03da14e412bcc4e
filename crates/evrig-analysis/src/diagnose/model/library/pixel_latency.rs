//! From the crossing to the request: events are late, the camera's own frames are not.

use super::{Candidate, EffectId, Freed, Nuisance, PLAIN};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::PixelLatency,
    equation: "t = t_cross + t_latency",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
    frees: &[Freed { nuisance: Nuisance::OffsetUs, range: [0.0, 120_000.0] }],
    starts: |evidence| match evidence.facts.clocks {
        Some(tied) if !tied.is_off() => {
            [2.0, 5.0, 10.0, 20.0, 40.0].iter().map(|ms| vec![ms * 1e3]).collect()
        }
        _ => Vec::new(),
    },
    report: |values| vec![values[Nuisance::OffsetUs as usize]],
    rivals: &[EffectId::FixedPole, EffectId::PhotoreceptorBandwidth, EffectId::ClockOffset],
    splitter: "a light step: a latency moves its events, a pole spreads them",
    needs: |evidence| match evidence.facts.clocks {
        Some(_) => Ok(()),
        None => Err("nothing ties the events' clock to the light's but the events themselves: a \
                     late clock and a late pixel are one number"
            .into()),
    },
    says: |values| {
        format!("events come {:.0} us behind their crossing; the frames are on time", values[0])
    },
    ..PLAIN
};
