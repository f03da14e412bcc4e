//! A row time of the frames that differs from the stated one.

use super::{LibraryEffect, ModelTerm, PLAIN, linear};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::RollingShutter,
    equation: "t_row = t_frame + y t_row",
    source: "Linux driver imx708.c: line length over pixel rate",
    term: Some(&TERM),
    competing: &[EffectId::ClockOffset, EffectId::RowReadout, EffectId::Misregistration],
    separating_recording: "one camera rotated by 180 degrees",
    describe: |values| format!("each row of the frames is {:.1} us later than stated", values[0]),
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::RollingShutter,
    parameters: &[linear("row_us", [-200.0, 200.0], 0.1)],
    changes_signal: false,
    ordinary: |_| [0.0; 2],
    starts: |_| vec![vec![1.0], vec![-1.0]],
    stage: 4,
    apply: |v, view| view.start_us += v[0] * (f64::from(view.y) + 0.5 - view.middle[1]),
    report: |_, all| all,
};
