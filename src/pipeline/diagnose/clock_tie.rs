//! The stated clock map against the registration of the event camera.

use evrig_analysis::diagnose::ClockTie;
use evrig_core::time::{Davis, Span, Stamp, Unix};
use evrig_reconstruct::clock::{SessionClocks, TimeReference};
use evrig_reconstruct::scene::Scene;

/// Largest bound of a clock statement that counts as one.
const MAX_STATED_BOUND_US: f64 = 5_000.0;

/// Stamps farther from Unix time belong to another clock.
const MAX_UNIX_OFFSET_US: f64 = 1e6;

/// The scene's clock tie against the session's clock map; `None` where the session states no
/// bounded map.
///
/// The stage `sync` corrects the map by motion, the registration of the scene by intensity: both
/// would absorb a delay of the event camera. The statement is the uncorrected reading of the
/// clocks.
///
/// `row_delay_us` is the delay of the exposure of the path's frames against their stamps.
pub(super) fn clock_tie(
    scene: &Scene,
    clocks: &SessionClocks,
    row_delay_us: f64,
) -> Option<ClockTie> {
    if clocks.reference != TimeReference::Host {
        return None;
    }
    let path = &scene.reconstruction.path;
    let registration = &scene.registration;
    let tie = registration.alignment;
    let [from_s, to_s] = path.span_s()?;
    let late_us = |path_s: f64| {
        let mapped_s = (path_s - tie.lag_s + tie.skew * tie.lag_at_s) / (1.0 + tie.skew);
        let pi = |s: f64| path.zero + Span::from_secs_f64(s);
        let tied: Stamp<Davis> = tie.pi_from_davis.inverse().map(pi(mapped_s));
        let unix: Stamp<Unix> = clocks.unix_from_sensor.map(pi(path_s))?;
        // The recorder stamps Unix time; a deviation is part of the question.
        let stated: Stamp<Davis> = Stamp::from_nanos(unix.as_nanos());
        Some((tied - stated).as_nanos() as f64 * 1e-3)
    };
    let (begin, end) = (late_us(from_s)?, late_us(to_s)?);
    let middle = path.zero + Span::from_secs_f64(0.5 * (from_s + to_s));
    let ends = clocks.unix_from_sensor.absolute95(middle);
    let within = ends.into_iter().map(|end| end.map(|e| e.as_nanos().abs() as f64 * 1e-3));
    let statement_bound_us = within.collect::<Option<Vec<f64>>>()?.into_iter().fold(0.0, f64::max);
    // Stamps that are seconds off are not Unix time.
    let is_meant = begin.abs().max(end.abs()) < MAX_UNIX_OFFSET_US;
    (statement_bound_us < MAX_STATED_BOUND_US && is_meant).then_some(ClockTie {
        offset_us: [0.5 * (begin + end) - row_delay_us, registration.alignment_error[8] * 1e6],
        skew_ppm: [
            (end - begin) / (to_s - from_s).max(1e-3),
            registration.alignment_error[9] * 1e6,
        ],
        statement_bound_us,
    })
}
