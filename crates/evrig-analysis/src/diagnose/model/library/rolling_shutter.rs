//! A row time of the frames that differs from the stated one.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::RollingShutter,
    equation: "t_row = t_frame + y t_row",
    source: "Linux driver imx708.c: line length over pixel rate",
    stage: CandidateStage::Clock,
    parameters: &[CandidateParameter::linear("row_us", [-200.0, 200.0], 0.5)],
    starting_points: |_| vec![vec![3.0], vec![-3.0], vec![15.0], vec![-15.0]],
    apply: |values, _, view| {
        view.start_us += values[0] * (f64::from(view.pixel.y) + 0.5 - view.evidence.middle[1]);
    },
    competing: &[EffectId::ClockOffset, EffectId::RowReadout, EffectId::Misregistration],
    separating_recording: "one camera rotated by 180 degrees",
    describe: |values| format!("each row of the frames is {:.1} us later than stated", values[0]),
    ..PLAIN
};
