//! Events lost on the way.

use super::{LibraryEffect, ModelTerm, PLAIN, log};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::EventDrop,
    equation: "each event is lost with chance q after the pixel was reset",
    source: "inivation: DropDVSOnTransferStall",
    term: Some(&TERM),
    competing: &[EffectId::RefractoryPeriod, EffectId::ReadoutSaturation],
    separating_recording: "a slower pass: losses on the bus grow with the event rate",
    describe: |values| {
        format!("{:.0} % of the events are lost behind the pixel", values[0] * 100.0)
    },
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::EventDrop,
    parameters: &[log("fraction", [1e-3, 0.9])],
    changes_signal: false,
    ordinary: |_| [0.0; 2],
    starts: |_| vec![vec![0.02], vec![0.15]],
    stage: 3,
    apply: |v, view| view.law.loss = v[0].min(0.95),
    report: |_, all| all,
};
