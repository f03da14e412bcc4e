//! Dark current of the event pixels.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, logs};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::DarkCurrent,
    equation: "x = ln(L / L_white + d)",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    stage: CandidateStage::Light,
    parameters: &[CandidateParameter::log("fraction_of_white", [1e-4, 1.0])],
    starting_points: |_| logs(&[0.005, 0.03, 0.15]),
    apply: |values, _, view| {
        let dark = values[0] as f32;
        view.signal.iter_mut().for_each(|signal| *signal = (signal.exp() + dark).ln());
    },
    // A pedestal below the stated one has the same law.
    same_law: &[EffectId::BlackLevel],
    competing: &[EffectId::BlackLevel, EffectId::ToneCurve, EffectId::PhotoreceptorBandwidth],
    separating_recording: "dark frames with the lens cap on give the pedestal; five times more \
         light makes dark current negligible",
    describe: |values| {
        format!(
            "dark current of {:.1} % of white reduces the contrast of dark pixels",
            values[0] * 100.0
        )
    },
    ..PLAIN
};
