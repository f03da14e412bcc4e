//! The paper's method errs as the original does.

use super::*;

fn pairs(sensor_us: &[i64], real_us: &[i64]) -> Vec<FramePair> {
    let stamps = sensor_us.iter().zip(real_us);
    stamps.map(|(s, r)| FramePair::new(Stamp::from_micros(*s), Stamp::from_micros(*r))).collect()
}

fn choice(estimate: &ClockEstimate) -> PaperChoice {
    estimate.diagnostics.paper.unwrap()
}

#[test]
fn the_frame_before_the_most_equal_interval_gives_the_offset() {
    let found = paper_interval(
        &pairs(&[0, 8_333, 16_666, 25_000], &[1_012_000, 1_022_100, 1_030_432, 1_040_000]),
        PaperUnit::Microseconds,
    )
    .unwrap();
    assert_eq!(choice(&found).frame, 1);
    let mapped = found.map(Stamp::from_micros(8_333)).unwrap();
    assert_eq!(mapped.as_micros(), 1_022_100);
    assert_eq!(found.map(Stamp::from_micros(0)).unwrap().as_micros(), 1_022_100 - 8_333);
}

#[test]
fn of_equal_intervals_the_first_wins() {
    let found =
        paper_interval(&pairs(&[0, 10, 20, 30, 40], &[5, 16, 26, 36, 47]), PaperUnit::Microseconds)
            .unwrap();
    assert_eq!((choice(&found).frame, choice(&found).n_ties), (1, 1));
}

#[test]
fn nothing_over_nothing_wins_over_every_number() {
    let found = paper_interval(
        &pairs(&[0, 10, 20, 20, 30], &[5, 15, 99, 99, 109]),
        PaperUnit::Microseconds,
    )
    .unwrap();
    assert_eq!((choice(&found).frame, choice(&found).n_undefined), (2, 1));
    assert_eq!(choice(&found).ratio, None);
}

#[test]
fn with_nanoseconds_the_longest_interval_wins() {
    let given = pairs(&[0, 8_333, 16_666, 25_000], &[12_000, 20_333, 95_000, 99_000]);
    let right = paper_interval(&given, PaperUnit::Microseconds).unwrap();
    let wrong = paper_interval(&given, PaperUnit::Nanoseconds).unwrap();
    assert_eq!((choice(&right).frame, choice(&wrong).frame), (0, 1));
}

#[test]
fn the_window_method_needs_a_window() {
    let sensor: Vec<i64> = (0..60).map(|i| i * 8_333).collect();
    let real: Vec<i64> = sensor.iter().map(|s| s + 12_000).collect();
    let short = FramePairs::check(&pairs(&sensor, &real)).unwrap();
    assert_eq!(
        paper_window(&short).unwrap_err(),
        ClockError::TooFewFrames { found: 60, needed: 124 }
    );
}
