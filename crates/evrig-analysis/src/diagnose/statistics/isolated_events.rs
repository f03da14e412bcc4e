//! Missing isolated events: a filter behind the camera passes only events with neighbours.
//!
//! Such a filter removes events without a neighbour's event within its window, so that the density
//! of the lag to the neighbours' last event drops at the window. No light and no pixel law has
//! such an edge. Periodic bursts (lamp, rows, frames) may end as sharply, but equally in the lag
//! to the neighbours' *next* event, which the filter does not know.

use crate::diagnose::evidence::event_context::EventContext;
use crate::diagnose::{Evidence, MisfitStratum, ProposedTerm};
use evrig_core::stats::Z90;
use rayon::prelude::*;

/// Events that are used; pixels are skipped in longer recordings (work budget).
const MAX_EVENTS: usize = 2_000_000;

/// Range of lags, and shortest lag in stamp steps: events are spread uniformly over a coarse step,
/// which blurs an edge.
const LAG_RANGE_US: [f64; 2] = [100.0, 1e6];
const MIN_LAG_STAMP_STEPS: f64 = 20.0;

/// Width of a bin of the log lag, and bins per side of an edge.
const BIN_LOG_WIDTH: f64 = 0.03;
const N_SIDE_BINS: usize = 4;

/// Least drop of the log rate beyond its changes near by, and significance level.
const MIN_LOG_DROP: f64 = std::f64::consts::LN_2;
const MIN_DROP_STANDARD_ERRORS: f64 = 5.0;

/// An edge in the density of the lag to the neighbours' last event.
#[derive(Debug, Clone, Copy)]
struct DeficitStep {
    /// Upper end of the edge, microseconds.
    us: f64,
    /// Events before the edge, expected behind it, and observed behind it.
    before: f64,
    expected: f64,
    behind: f64,
    /// Standard error of the log ratio of observed to expected.
    error: f64,
}

/// A deficit of isolated events: its stratum, and the term that describes it.
pub(crate) struct IsolatedEventDeficit {
    pub(crate) place: MisfitStratum,
    pub(crate) term: ProposedTerm,
}

pub(super) fn missing(evidence: &Evidence) -> Option<IsolatedEventDeficit> {
    let stamp_us = evidence.facts.stamp_step_us.unwrap_or(1.0);
    let shortest_us = LAG_RANGE_US[0].max(MIN_LAG_STAMP_STEPS * stamp_us);
    let (step, n_events) = found(&evidence.event_context, shortest_us)?;
    Some(step.report(n_events))
}

/// The edge, if significant, with the number of events used.
fn found(around: &EventContext, shortest_us: f64) -> Option<(DeficitStep, usize)> {
    let (since, until) = gaps(around);
    let step = step(&counts(&since, shortest_us), &counts(&until, shortest_us), shortest_us)?;
    Some((step, since.len()))
}

/// Lags to the last and the next event of the eight neighbours, microseconds; zero for equal
/// stamps.
fn gaps(around: &EventContext) -> (Vec<i64>, Vec<i64>) {
    let recording = around.recording();
    let size = recording.size();
    let every = recording.len().div_ceil(MAX_EVENTS).max(1);
    let of_pixel = |number: usize| {
        let (x, y) = ((number % size.width as usize) as u16, (number / size.width as usize) as u16);
        let own = recording.of(x, y).iter();
        own.map(move |spike| around.gaps_us(x, y, spike.t_us)).collect::<Vec<_>>()
    };
    let numbers = (0..size.n_pixels()).into_par_iter().step_by(every);
    numbers.flat_map_iter(of_pixel).unzip()
}

fn counts(gaps: &[i64], shortest_us: f64) -> Vec<f64> {
    let n_bins = ((LAG_RANGE_US[1] / shortest_us).ln() / BIN_LOG_WIDTH) as usize;
    let mut counts = vec![0.0; n_bins];
    for gap in gaps.iter().filter(|gap| **gap as f64 >= shortest_us) {
        let bin = ((*gap as f64 / shortest_us).ln() / BIN_LOG_WIDTH) as usize;
        if let Some(count) = counts.get_mut(bin) {
            *count += 1.0;
        }
    }
    counts
}

/// The most significant downward edge. The bin between its sides is skipped: the edge lies within.
fn step(since: &[f64], until: &[f64], shortest_us: f64) -> Option<DeficitStep> {
    let side = |counts: &[f64], first: usize| -> f64 {
        0.5 + counts[first..first + N_SIDE_BINS].iter().sum::<f64>()
    };
    let last = since.len().checked_sub(2 * N_SIDE_BINS)?;
    let steps = (3 * N_SIDE_BINS..last).map(|at| {
        let [before_that, earlier] = [3, 2].map(|sides| side(since, at - sides * N_SIDE_BINS));
        let (before, behind) = (side(since, at - N_SIDE_BINS), side(since, at + 1));
        let later = side(since, at + 1 + N_SIDE_BINS);
        let mirrored = [side(until, at - N_SIDE_BINS), side(until, at + 1)];
        // A peak rises as fast as it falls.
        let changes =
            [before_that / earlier, earlier / before, behind / later, mirrored[0] / mirrored[1]];
        let fall = changes.into_iter().map(|ratio| ratio.ln().abs()).fold(0.0, f64::max);
        let all = [before_that, earlier, before, behind, later, mirrored[0], mirrored[1]];
        let us = shortest_us * (BIN_LOG_WIDTH * (at as f64 + 0.5)).exp();
        let error = all.iter().map(|n| 1.0 / n).sum::<f64>().sqrt();
        DeficitStep { us, before, expected: before * (-fall).exp(), behind, error }
    });
    let sure = steps.filter(|step| {
        step.size() > MIN_LOG_DROP && step.size() > MIN_DROP_STANDARD_ERRORS * step.error
    });
    sure.max_by(|a, b| (a.size() / a.error).total_cmp(&(b.size() / b.error)))
}

impl DeficitStep {
    /// Log ratio of expected to observed.
    fn size(&self) -> f64 {
        (self.expected / self.behind).ln()
    }

    fn report(self, n_events: usize) -> IsolatedEventDeficit {
        let Self { us, before, expected, behind, error } = self;
        let ratio = behind / expected;
        let end = us * (BIN_LOG_WIDTH * (N_SIDE_BINS as f64 + 0.5)).exp();
        // Poisson log-likelihood gain of the observed mean, per event.
        let nats = (expected - behind - behind * (expected / behind).ln()) / n_events as f64;
        let description = format!(
            "{ratio:.2} events per expected event {us:.0} to {end:.0} us after the last event of \
             the eight neighbours: isolated events are missing, as behind a neighbour filter"
        );
        let point = |reference_us: f64, log: f64, error: f64| {
            [reference_us, log, log - Z90 * error, log + Z90 * error]
        };
        let half = (-0.5 * BIN_LOG_WIDTH * N_SIDE_BINS as f64).exp();
        IsolatedEventDeficit {
            place: MisfitStratum {
                covariate: "neighbour_us".into(),
                range: [us, end],
                excess_nats_per_event: nats,
                innovation_thresholds: None,
                ratio: Some(ratio),
                n_events: behind as u64,
                description,
            },
            term: ProposedTerm {
                enters: "hazard".into(),
                depends_on: "neighbour_us".into(),
                curve: vec![
                    point(us * half, 0.0, before.sqrt().recip()),
                    point(us / half, ratio.ln(), error),
                ],
                heldout_gain_nats_per_event: nats,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::StampGrid;
    use crate::filter::background;
    use crate::predict::EventsByPixel;
    use evrig_core::event::{Event, Events};
    use evrig_core::geometry::Size;
    use evrig_core::stats::SplitMix;

    const SIDE_PX: u16 = 64;
    const LENGTH_US: i64 = 8_000_000;

    /// Edges passing ten times a second, and noise of 3 Hz, in ascending time.
    fn unfiltered() -> Events {
        let mut random = SplitMix::new(7, 7);
        let mut events = Vec::new();
        for pixel in 0..SIDE_PX * SIDE_PX {
            let (x, y) = (pixel % SIDE_PX, pixel / SIDE_PX);
            for pass in 0..80 {
                let at = f64::from(pass) * 1e5 + f64::from(x) * 1_500.0;
                events.push((at + 1_500.0 * random.exponential(), x, y));
            }
            let mut at = 0.0;
            while at < LENGTH_US as f64 {
                at += 1e6 / 3.0 * random.exponential();
                events.push((at, x, y));
            }
        }
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
        events.into_iter().map(|(t, x, y)| Event { t: t as i64, x, y, on: true }).collect()
    }

    const SIZE: Size = Size::new(SIDE_PX, SIDE_PX);

    fn step_in(events: &Events, shortest_us: f64) -> Option<DeficitStep> {
        let recording = EventsByPixel::new(events.as_slice(), SIZE, [0, LENGTH_US]);
        found(&EventContext::new(recording, &[]), shortest_us).map(|(step, _)| step)
    }

    #[test]
    fn isolated_events_are_missing_only_behind_a_filter() {
        let unfiltered = unfiltered();
        for window_us in [6_000, 12_000] {
            let filtered = background::filter(unfiltered.as_slice(), SIZE, window_us).unwrap();
            let step = step_in(&filtered.events, LAG_RANGE_US[0]).unwrap();
            assert!(
                (step.us / window_us as f64).ln().abs() < BIN_LOG_WIDTH,
                "{window_us} us: {step:?}"
            );
        }
        assert!(step_in(&unfiltered, LAG_RANGE_US[0]).is_none());
    }

    #[test]
    fn a_filter_is_found_with_coarse_stamps() {
        let filtered = background::filter(unfiltered().as_slice(), SIZE, 9_000).unwrap();
        let in_steps = filtered.events.as_slice().iter().map(|e| Event { t: e.t / 250 * 250, ..e });
        let in_steps: Events = in_steps.collect();
        let grid = StampGrid::of_events(in_steps.as_slice()).unwrap();
        let spread = grid.spread(in_steps.as_slice());
        let step = step_in(&spread, MIN_LAG_STAMP_STEPS * grid.step_us).unwrap();
        assert!((step.us / 9_000.0).ln().abs() < 2.0 * BIN_LOG_WIDTH, "{step:?}");
    }

    #[test]
    fn a_symmetric_edge_or_a_peak_is_no_filter() {
        let counts = |of: fn(usize) -> f64| (0..40).map(of).collect::<Vec<_>>();
        let flat = counts(|_| 200.0);
        let falls = counts(|bin| if bin < 20 { 200.0 } else { 20.0 });
        let peak = counts(|bin| if (16..20).contains(&bin) { 200.0 } else { 20.0 });
        assert!(step(&falls, &flat, 100.0).is_some());
        assert!(step(&falls, &falls, 100.0).is_none());
        assert!(step(&peak, &flat, 100.0).is_none());
    }

    #[test]
    fn abrupt_bursts_are_no_filter() {
        // All pixels fire within 4 ms of every 10 ms, with noise in between.
        let unfiltered = unfiltered();
        let noise = unfiltered.as_slice().iter().step_by(9);
        let mut random = SplitMix::new(8, 8);
        let lit = (0..SIDE_PX * SIDE_PX).flat_map(|pixel| (0..800).map(move |beat| (pixel, beat)));
        let beats = lit.filter(|(pixel, beat)| (pixel + 7 * beat) % 5 == 0).map(|(pixel, beat)| {
            let t = i64::from(beat) * 10_000 + random.below(4_000) as i64;
            Event { t, x: pixel % SIDE_PX, y: pixel / SIDE_PX, on: true }
        });
        let all: Events = noise.chain(beats).collect();
        assert!(step_in(&all, LAG_RANGE_US[0]).is_none());
    }

    #[test]
    fn a_deficit_has_a_stratum_and_a_term() {
        let step = DeficitStep {
            us: 10_000.0,
            before: 1_200.0,
            expected: 1_000.0,
            behind: 200.0,
            error: 0.1,
        };
        let IsolatedEventDeficit { place, term } = step.report(1_000_000);
        assert_eq!((place.ratio, place.n_events), (Some(0.2), 200));
        assert!(
            place.description.starts_with("0.20 events per expected event"),
            "{}",
            place.description
        );
        let nats = (800.0 - 200.0 * 5.0_f64.ln()) * 1e-6;
        assert!((term.heldout_gain_nats_per_event - nats).abs() < 1e-12);
        assert!((term.curve[1][1] - 0.2_f64.ln()).abs() < 1e-12 && term.curve[0][0] < 10_000.0);
    }
}
