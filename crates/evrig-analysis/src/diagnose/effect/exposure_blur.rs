//! Frames with a longer exposure than stated.

use super::{LibraryEffect, ModelTerm, PLAIN, log, needs_surroundings};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ExposureBlur,
    equation: "L_frame = (1 / T) int L dt",
    source: "Rebecq, Gehrig and Scaramuzza, ESIM, CoRL 2018",
    term: Some(&TERM),
    competing: &[EffectId::Defocus, EffectId::FrameInterpolation],
    separating_recording: "a pass at half the exposure, and one at half the speed",
    requires: needs_surroundings,
    describe: |values| format!("the frames are blurred as by an exposure of {:.0} us", values[0]),
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::ExposureBlur,
    parameters: &[log("exposure_us", [1_000.0, 60_000.0])],
    changes_signal: true,
    ordinary: |_| [0.0; 2],
    starts: |e| if e.facts.from_scene { vec![vec![8_000.0]] } else { vec![] },
    stage: 0,
    apply: |v, view| {
        // A mean over T adds T^2 / 24 of the curvature.
        let h = 4_000.0 / view.step_us;
        let half = (h.round() as usize).max(1);
        let factor = (v[0] / (half as f64 * view.step_us)).powi(2) / 24.0;
        let old = view.signal.clone();
        for i in half..old.len().saturating_sub(half) {
            let curvature = old[i - half] - 2.0 * old[i] + old[i + half];
            view.signal[i] -= (factor * curvature).clamp(-0.5, 0.5);
        }
    },
    report: |_, all| all,
};
