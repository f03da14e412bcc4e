//! Delay from threshold crossing to event; the camera's own frames are on time.

use super::{LibraryEffect, PLAIN};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::PixelLatency,
    equation: "t = t_cross + t_latency",
    source: "Joubert et al., Front. Neurosci. 15, 2021",
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
