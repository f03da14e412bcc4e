//! Frames that are noisier than stated.

use super::{Candidate, EffectId, PLAIN, needs_shown};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::FrameNoise,
    equation: "var s = r^2 + a s + p s^2, r^2 = stated^2 + sigma^2",
    source: "EMVA standard 1288: photon transfer",
    rivals: &[EffectId::ShotNoise, EffectId::StampJitter],
    splitter: "frames with the lens cap on",
    needs: |evidence| {
        needs_shown(
            evidence,
            EffectId::FrameNoise,
            "it takes raw frames of a print, and a rig that states `read_noise_dn` of the frame camera",
        )
    },
    ..PLAIN
};
