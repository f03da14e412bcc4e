//! The event camera's clock runs fast.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, needs_span};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ClockSkew,
    equation: "t_DAVIS = (1 + e) t",
    source: "Olson, IROS 2010",
    stage: Stage::Clock,
    parameters: &[Parameter::linear("skew_ppm", [-20_000.0, 20_000.0], 20.0)],
    starts: |_| vec![vec![100.0], vec![-100.0], vec![1_500.0], vec![-1_500.0]],
    act: |values, _, view| {
        // About the middle of the recording, so that skew and offset are told apart.
        let middle = view.evidence.blocks.length_us() as f64 / 2.0;
        let fast = 1.0 + values[0] * 1e-6;
        view.start_us = middle + (view.start_us - middle) * fast;
        view.step_us *= fast;
    },
    rivals: &[EffectId::ClockOffset, EffectId::TemperatureDrift],
    splitter: "a longer recording: a skew grows with it",
    needs: |evidence| needs_span(evidence, 1.0),
    says: |values| format!("the event camera's clock gains {:.0} us a second", values[0]),
    ..PLAIN
};
