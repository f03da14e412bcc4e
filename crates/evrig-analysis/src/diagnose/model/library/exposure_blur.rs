//! Frames with a longer exposure than stated.

use super::{
    CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, logs, needs_surroundings,
};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::ExposureBlur,
    equation: "L_frame = (1 / T) int L dt",
    source: "Rebecq, Gehrig and Scaramuzza, ESIM, CoRL 2018",
    stage: CandidateStage::Light,
    parameters: &[CandidateParameter::log("exposure_us", [1_000.0, 60_000.0])],
    starting_points: |_| logs(&[5_000.0, 15_000.0]),
    apply: |values, _, view| {
        // To second order a mean over T adds T^2 / 24 of the curvature, which is subtracted.
        let half = ((0.5 * values[0] / view.step_us).round() as usize).max(1);
        let blurred = view.signal.clone();
        for i in half..blurred.len().saturating_sub(half) {
            let curvature = blurred[i - half] - 2.0 * blurred[i] + blurred[i + half];
            view.signal[i] -= (curvature / 6.0).clamp(-0.5, 0.5);
        }
    },
    competing: &[EffectId::Defocus, EffectId::FrameInterpolation],
    separating_recording: "a pass at half the exposure, and one at half the speed",
    requires: needs_surroundings,
    describe: |values| format!("the frames are blurred as by an exposure of {:.0} us", values[0]),
    ..PLAIN
};
