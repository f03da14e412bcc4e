//! What the session states of its clocks, against what ties the event camera to the light.

use evrig_analysis::diagnose::TiedClocks;
use evrig_core::time::{Davis, Span, Stamp, Unix};
use evrig_reconstruct::clock::{SessionClocks, TimeReference};
use evrig_reconstruct::scene::Scene;

/// Where nothing bounds the statement, it is not one.
const LEAST_SURE_US: f64 = 5_000.0;

/// Farther from Unix time stamps are of a clock of their own.
const MOST_LATE_US: f64 = 1e6;

/// The tie of a scene against the session's own map of its clocks; `None` where the session states
/// no more than a guess.
///
/// The stage `sync` lets the motion that both cameras saw correct the map, and the scene's tie
/// corrects it by the light: both would take a late event camera for an error of the map. What the
/// clocks themselves were read to show is the statement.
///
/// `later_us` is by how much later than its frames state the light of the path was.
pub(super) fn tied_clocks(
    scene: &Scene,
    clocks: &SessionClocks,
    later_us: f64,
) -> Option<TiedClocks> {
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
        // The recorder stamps Unix time; arrivals that say otherwise are a part of what is asked.
        let stated: Stamp<Davis> = Stamp::from_nanos(unix.as_nanos());
        Some((tied - stated).as_nanos() as f64 * 1e-3)
    };
    let (begin, end) = (late_us(from_s)?, late_us(to_s)?);
    let middle = path.zero + Span::from_secs_f64(0.5 * (from_s + to_s));
    let ends = clocks.unix_from_sensor.absolute95(middle);
    let within = ends.into_iter().map(|end| end.map(|e| e.as_nanos().abs() as f64 * 1e-3));
    let within_us = within.collect::<Option<Vec<f64>>>()?.into_iter().fold(0.0, f64::max);
    // Stamps that are seconds off were never meant for Unix time.
    let is_meant = begin.abs().max(end.abs()) < MOST_LATE_US;
    (within_us < LEAST_SURE_US && is_meant).then_some(TiedClocks {
        offset_us: [0.5 * (begin + end) - later_us, registration.alignment_error[8] * 1e6],
        skew_ppm: [
            (end - begin) / (to_s - from_s).max(1e-3),
            registration.alignment_error[9] * 1e6,
        ],
        within_us,
    })
}
