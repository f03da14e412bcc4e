//! Two-sided readings bound the offset.

use super::simulation::{Clocks, Family, Scenario, record};
use super::*;

const OFFSET_NS: i64 = 1_700_000_000_000_000_000;

fn reading(group: u64, at_ms: i64, width_ns: i64, offset_ns: i64) -> TwoSidedReading {
    let before = at_ms * 1_000_000;
    TwoSidedReading {
        group,
        before: Stamp::from_nanos(before),
        real: Stamp::from_nanos(before + width_ns / 3 + OFFSET_NS + offset_ns),
        after: Stamp::from_nanos(before + width_ns),
    }
}

fn offset_at(estimate: &ClockEstimate, ms: i64) -> i64 {
    let at = Stamp::from_nanos(ms * 1_000_000);
    estimate.map(at).unwrap().as_nanos() - at.as_nanos() - OFFSET_NS
}

#[test]
fn the_narrowest_of_a_group_bounds_the_offset() {
    let readings = [reading(0, 0, 900_000, 0), reading(0, 1, 300, 0), reading(0, 2, 5_000, 0)];
    let found = clock_pair(&readings, &PairOptions::default()).unwrap();
    assert_eq!(offset_at(&found, 0), -50);
    let [low, high] = found.statistical95(Stamp::from_nanos(0)).unwrap();
    assert_eq!((low, high), (Span::from_nanos(-151), Span::from_nanos(151)));
    assert_eq!(found.absolute95(Stamp::from_nanos(0)), [Some(low), Some(high)]);
}

#[test]
fn a_step_begins_a_segment_and_one_strange_reading_does_not() {
    let mut readings: Vec<_> = (0..10).map(|i| reading(i, i as i64 * 100, 300, 0)).collect();
    readings.extend((10..20).map(|i| reading(i, i as i64 * 100, 300, -20_000_000)));
    readings[4] = reading(4, 400, 300, 7_000_000);
    let found = clock_pair(&readings, &PairOptions::default()).unwrap();
    assert_eq!((found.n_steps(), found.diagnostics.n_readings_rejected), (1, 1));
    assert!((offset_at(&found, 500) + 50).abs() <= 50);
    assert!((offset_at(&found, 1_500) + 20_000_050).abs() <= 50);
    assert!(found.is_doubtful(Stamp::from_nanos(950_000_000)));
    assert!(!found.is_doubtful(Stamp::from_nanos(850_000_000)));
}

#[test]
fn readings_that_end_before_they_begin_are_counted_and_alone_are_an_error() {
    let reversed = TwoSidedReading { after: Stamp::from_nanos(-5), ..reading(0, 0, 300, 0) };
    assert_eq!(
        clock_pair(&[reversed], &PairOptions::default()).unwrap_err(),
        ClockError::NoReadings { n_seen: 1, n_reversed: 1 }
    );
    let found = clock_pair(&[reversed, reading(1, 5, 300, 0)], &PairOptions::default()).unwrap();
    assert_eq!((found.tally.n_seen, found.tally.n_kept), (2, 1));
}

#[test]
fn a_simulated_minute_comes_back_within_its_bounds_without_any_latency() {
    let scenario = Scenario {
        family: Family::Gamma,
        clocks: Clocks::KernelStep,
        fps: 120.0,
        duration_s: 10.0,
    };
    for seed in 0..10 {
        let recording = record(scenario, seed);
        let found = clock_pair(&recording.readings, &PairOptions::default()).unwrap();
        let smallest = Span::from_secs_f64(super::simulation::SMALLEST_S);
        for (pair, truth) in recording.pairs.iter().zip(&recording.truth) {
            if found.is_doubtful(pair.sensor) {
                continue;
            }
            let off = (*truth - smallest) - found.map(pair.sensor).unwrap();
            let [low, high] = found.statistical95(pair.sensor).unwrap();
            // The simulation itself rounds to the nanosecond, twice.
            let slack = Span::from_nanos(2);
            assert!(low - slack <= off && off <= high + slack, "seed {seed}: {off:?}");
        }
    }
}
