//! The event camera's clock runs fast.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, needs_span};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ClockSkew,
    equation: "t_DAVIS = (1 + e) t",
    source: "Olson, IROS 2010",
    stage: Stage::Clock,
    parameters: &[Parameter::linear("skew_ppm", [-20_000.0, 20_000.0], 20.0)],
    starts: |evidence| {
        let tied = evidence.facts.clocks.map(|tied| tied.skew_ppm[0]);
        // Where nothing ties the clocks a start some ms off at either end is behind another ridge.
        let far: &[f64] = if tied.is_some() { &[] } else { &[4e3, 7e3, 10e3, 13e3, 16e3, 19e3] };
        let both = [100.0, 1_500.0].iter().chain(far).flat_map(|ppm| [*ppm, -*ppm]);
        tied.into_iter().chain(both).map(|ppm| vec![ppm]).collect()
    },
    act: |values, _, view| {
        // A clock that was set at the start goes off from there.
        let fast = 1.0 + values[0] * 1e-6;
        view.start_us *= fast;
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
