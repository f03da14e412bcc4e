//! Dark current of the event pixels.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, logs};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::DarkCurrent,
    equation: "x = ln(L / L_white + d)",
    source: "Nozaki and Delbruck, IEEE Trans. Electron Devices 64, 2017",
    stage: Stage::Light,
    parameters: &[Parameter::log("fraction_of_white", [1e-4, 1.0])],
    starts: |_| logs(&[0.005, 0.03, 0.15]),
    act: |values, _, view| {
        let dark = values[0] as f32;
        view.signal.iter_mut().for_each(|signal| *signal = (signal.exp() + dark).ln());
    },
    // Frames whose pedestal is less than stated.
    twins: &[EffectId::BlackLevel],
    rivals: &[EffectId::BlackLevel, EffectId::ToneCurve, EffectId::PhotoreceptorBandwidth],
    splitter: "frames with the lens cap on state the frames' pedestal; light five times stronger makes dark current small",
    says: |values| {
        format!(
            "in the dark the event pixels see less contrast, as with a current of {:.1} % of white",
            values[0] * 100.0
        )
    },
    ..PLAIN
};
