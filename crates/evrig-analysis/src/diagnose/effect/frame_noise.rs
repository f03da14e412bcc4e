//! Frames that are noisier than stated.

use super::{LibraryEffect, PLAIN, needs_shown};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::FrameNoise,
    equation: "var s = r^2 + a s + p s^2, r^2 = stated^2 + sigma^2",
    source: "EMVA standard 1288: photon transfer",
    competing: &[EffectId::ShotNoise, EffectId::StampJitter],
    separating_recording: "frames with the lens cap on",
    requires: |evidence| {
        needs_shown(
            evidence,
            EffectId::FrameNoise,
            "it needs raw frames of a printed target, and a rig that states `read_noise_dn` of \
             the frame camera",
        )
    },
    ..PLAIN
};
