//! The event camera's clock runs fast.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, needs_span};

/// Starting skews without a clock tie: spacing and number to either side. A start that is
/// milliseconds off at an end of the recording lies in another local maximum.
const START_SPACING_PPM: f64 = 3_000.0;
const N_STARTS_PER_SIDE: i32 = 16;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::ClockSkew,
    equation: "t_DAVIS = (1 + e) t",
    source: "Olson, IROS 2010",
    stage: CandidateStage::Clock,
    // 24 frames per second stamped as 25 are 42 000 ppm fast.
    parameters: &[CandidateParameter::linear("skew_ppm", [-50_000.0, 50_000.0], 20.0)],
    starting_points: |evidence| {
        let tied = evidence.facts.clock_tie.map(|tied| tied.skew_ppm[0]);
        let n_far = if tied.is_some() { 0 } else { N_STARTS_PER_SIDE };
        let far = (1..=n_far).map(|n| f64::from(n) * START_SPACING_PPM);
        let both = [100.0, 1_500.0].into_iter().chain(far).flat_map(|ppm| [ppm, -ppm]);
        tied.into_iter().chain(both).map(|ppm| vec![ppm]).collect()
    },
    apply: |values, _, view| {
        // The clock was set at the start.
        let fast = 1.0 + values[0] * 1e-6;
        view.start_us *= fast;
        view.step_us *= fast;
    },
    // Skew and offset are correlated; the clock tie fixes the combination.
    offset_us: |evidence, values| {
        let tied = evidence.facts.clock_tie?;
        let middle_us = evidence.start_us + 0.5e6 * evidence.seconds();
        Some(tied.offset_us[0] - values[0] * 1e-6 * middle_us)
    },
    reference_error: |evidence| {
        let half_s = 0.5 * evidence.seconds();
        evidence.facts.clock_error_us()[1] / half_s
    },
    competing: &[EffectId::ClockOffset, EffectId::TemperatureDrift],
    separating_recording: "a longer recording: the effect of a skew grows with it",
    requires: |evidence| needs_span(evidence, 1.0),
    has_signature: |evidence, values| {
        // The camera's own frames share the clock of its events.
        let half = |tied: f64| tied * values[0].signum() > 0.5 * values[0].abs();
        evidence.facts.clock_tie.is_none_or(|tied| half(tied.skew_ppm[0]))
    },
    describe: |values| format!("the event camera's clock gains {:.0} us per second", values[0]),
    ..PLAIN
};
