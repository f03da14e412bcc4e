//! The event camera's clock runs fast.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, needs_span};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ClockSkew,
    equation: "t_DAVIS = (1 + e) t",
    source: "Olson, IROS 2010",
    stage: Stage::Clock,
    parameters: &[Parameter::linear("skew_ppm", [-20_000.0, 20_000.0], 20.0)],
    starts: |evidence| {
        let tied = evidence.facts.clocks.map(|tied| vec![tied.skew_ppm[0]]);
        let guesses = [100.0, -100.0, 1_500.0, -1_500.0].map(|ppm| vec![ppm]);
        tied.into_iter().chain(guesses).collect()
    },
    act: |values, _, view| {
        // A clock that was set at the start goes off from there. Where nothing is stated of the
        // clocks the offset is anyone's guess: about the middle the two are told apart.
        let is_stated = view.evidence.facts.clocks.is_some();
        let share = if is_stated { 0.0 } else { 0.5 };
        let middle = view.evidence.blocks.length_us() as f64 * share;
        let fast = 1.0 + values[0] * 1e-6;
        view.start_us = middle + (view.start_us - middle) * fast;
        view.step_us *= fast;
    },
    // Skew and offset lie along a ridge; the tie says where on it.
    offset_us: |evidence, values| {
        let tied = evidence.facts.clocks?;
        let middle_us = evidence.start_us + 0.5e6 * evidence.seconds();
        Some(tied.offset_us[0] - values[0] * 1e-6 * middle_us)
    },
    against: |evidence| {
        let half_s = 0.5 * evidence.seconds();
        evidence.facts.clocks.map_or(0.0, |tied| tied.error()[1] / half_s)
    },
    rivals: &[EffectId::ClockOffset, EffectId::TemperatureDrift],
    splitter: "a longer recording: a skew grows with it",
    needs: |evidence| needs_span(evidence, 1.0),
    agrees: |evidence, values| {
        // The camera's own frames run on the clock of its events: where they tell it, they agree.
        let half = |tied: f64| tied * values[0].signum() > 0.5 * values[0].abs();
        evidence.facts.clocks.is_none_or(|tied| half(tied.skew_ppm[0]))
    },
    says: |values| format!("the event camera's clock gains {:.0} us a second", values[0]),
    ..PLAIN
};
