//! Bursts of events that follow the camera's own frames.

use super::{LibraryEffect, ModelTerm, PLAIN, log};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ApsCoupling,
    equation: "additional events at t_frame + d + y t_row",
    source: "Brandli et al., IEEE JSSC 49, 2014; Taverni et al., IEEE TCAS II 65, 2018",
    term: Some(&TERM),
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::ApsCoupling,
    parameters: &[log("rate_factor", [0.05, 20.0])],
    changes_signal: false,
    ordinary: |_| [0.0; 2],
    starts: |e| if e.bursts.is_some() { vec![vec![1.0]] } else { vec![] },
    stage: 3,
    apply: |v, view| view.law.burst_factor = v[0],
    report: |evidence, _| evidence.bursts.as_ref().map_or(vec![], |bursts| bursts.parameters()),
};
