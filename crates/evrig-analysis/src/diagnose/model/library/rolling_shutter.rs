//! Rows of a frame follow each other otherwise than stated.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::RollingShutter,
    equation: "t_row = t_frame + y t_row",
    source: "Linux driver imx708.c: line length over pixel rate",
    stage: Stage::Clock,
    parameters: &[Parameter::linear("row_us", [-200.0, 200.0], 0.5)],
    starts: |_| vec![vec![3.0], vec![-3.0], vec![15.0], vec![-15.0]],
    act: |values, _, view| {
        view.start_us += values[0] * (f64::from(view.pixel.y) + 0.5 - view.evidence.middle[1]);
    },
    rivals: &[EffectId::ClockOffset, EffectId::RowReadout, EffectId::Misregistration],
    splitter: "one camera turned upside down",
    says: |values| format!("each row of the light is {:.1} us later than stated", values[0]),
    ..PLAIN
};
