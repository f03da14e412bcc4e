//! Band-limited noise of the photoreceptor.

use super::{LibraryEffect, ModelTerm, PLAIN, log};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ShotNoise,
    equation: "event when |V + n - n_mem| > theta, n band-limited",
    source: "Rice, Bell Syst. Tech. J. 24, 1945; \
             Graca, Paredes-Valles and Delbruck, arXiv 2304.04019",
    term: Some(&TERM),
    competing: &[EffectId::BackgroundActivity, EffectId::FrameNoise, EffectId::StampJitter],
    separating_recording: "a static segment: more than 3/4 of the noise events alternate in \
         polarity",
    requires: |evidence| {
        if evidence.facts.from_scene {
            Ok(())
        } else {
            Err("without a map, changes between frames cannot be separated from noise".into())
        }
    },
    describe: |values| {
        format!("noise of {:.2} thresholds causes events of alternating polarity", values[0])
    },
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::ShotNoise,
    parameters: &[log("rms_thresholds", [0.02, 1.5]), log("bandwidth_hz", [1.0, 5_000.0])],
    changes_signal: false,
    ordinary: |_| [0.0; 2],
    starts: |_| {
        [[0.08, 100.0], [0.08, 500.0], [0.15, 300.0], [0.25, 300.0]]
            .iter()
            .map(|s| s.to_vec())
            .collect()
    },
    stage: 3,
    apply: |v, view| {
        view.law.shot_rms = v[0] * 0.5 * (view.law.theta[0] + view.law.theta[1]);
        view.law.shot_hz = v[1];
    },
    report: |_, all| all,
};
