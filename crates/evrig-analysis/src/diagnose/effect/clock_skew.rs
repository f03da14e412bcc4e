//! The event camera's clock runs fast.

use super::{LibraryEffect, ModelTerm, PLAIN, linear, needs_span};
use crate::diagnose::Evidence;
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::ClockSkew,
    equation: "t_DAVIS = (1 + e) t",
    source: "Olson, IROS 2010",
    term: Some(&TERM),
    competing: &[EffectId::ClockOffset, EffectId::TemperatureDrift],
    separating_recording: "a longer recording: the effect of a skew grows with it",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| format!("the event camera's clock gains {:.0} us per second", values[0]),
    ..PLAIN
};

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::ClockSkew,
    parameters: &[linear("skew_ppm", [-50_000.0, 50_000.0], 2.0)],
    changes_signal: false,
    ordinary: |evidence| [0.0, ordinary_skew_ppm(evidence)],
    starts: |evidence| {
        // Without a measured clock, 24 frames per second may be stamped as 25: 42 000 ppm.
        const UNMEASURED_PPM: [f64; 4] = [5_000.0, 10_000.0, 20_000.0, 42_000.0];
        let tied = evidence.facts.clock_tie.map(|tied| tied.skew_ppm[0]);
        let far = if tied.is_some() { &UNMEASURED_PPM[..0] } else { &UNMEASURED_PPM[..] };
        let both = [100.0, 1_500.0].iter().chain(far).flat_map(|ppm| [*ppm, -ppm]);
        tied.into_iter().chain(both).map(|ppm| vec![ppm]).collect()
    },
    stage: 4,
    apply: |v, view| {
        // The clock was set at the start.
        let fast = 1.0 + v[0] * 1e-6;
        view.start_us *= fast;
        view.step_us *= fast;
    },
    report: |_, all| all,
};

/// Skew that moves the ends of a recording by no more than the bound on the stated clock.
fn ordinary_skew_ppm(evidence: &Evidence) -> f64 {
    let facts = &evidence.facts;
    let bound_us = facts.clock_tie.map_or(facts.offset_bound_us, |tied| tied.statement_bound_us);
    bound_us / (0.5 * evidence.seconds())
}
