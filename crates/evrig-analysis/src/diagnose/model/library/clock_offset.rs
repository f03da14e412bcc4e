//! The clocks' offset, when it is not what the session states.

use super::{Candidate, EffectId, Freed, Nuisance, PLAIN};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ClockOffset,
    equation: "t_DAVIS = t + d",
    source: "clock map of the session",
    frees: &[Freed { nuisance: Nuisance::OffsetUs, range: [-120_000.0, 120_000.0] }],
    starts: |evidence| {
        // Where the camera's own frames are on time a delay of its events is the pixels' own.
        match evidence.facts.clocks {
            Some(tied) if tied.is_off() => return vec![vec![tied.offset_us[0]]],
            Some(_) => return Vec::new(),
            None => {}
        }
        // Between frames that are led along a start some ms off is behind another ridge.
        let near = [2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 60.0];
        let far = [70.0, 80.0, 90.0, 100.0, 110.0];
        let ms = near.iter().chain(&far).flat_map(|ms| [*ms, -*ms]);
        ms.map(|ms| vec![ms * 1e3]).collect()
    },
    report: |values| vec![values[Nuisance::OffsetUs as usize]],
    rivals: &[
        EffectId::FixedPole,
        EffectId::PhotoreceptorBandwidth,
        EffectId::RollingShutter,
        EffectId::Misregistration,
    ],
    // A delay that is the same for all pixels at all times is one number, wherever it arises,
    // unless the camera's own frames say whether they are late too.
    same: &[EffectId::PixelLatency],
    against: |evidence| evidence.facts.clock_error_us()[0],
    splitter: "a flash that both cameras see",
    says: |values| {
        let way = if values[0] > 0.0 { "late" } else { "early" };
        format!("the event camera's stamps are {:.0} us {way} against the light", values[0].abs())
    },
    ..PLAIN
};
