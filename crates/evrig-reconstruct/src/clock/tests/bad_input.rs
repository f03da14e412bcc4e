//! What is wrong with the evidence is named or counted.

use super::*;

fn good(n: i64) -> Vec<FramePair> {
    let at = |i: i64| i * 8_333_000 + 5_000_000_000_000;
    (0..n)
        .map(|i| {
            let late = 12_000_000 + (i * 7_919 % 1_000) * 1_000;
            let real = at(i) + 1_760_000_000_000_000_000 + late;
            FramePair::new(Stamp::from_nanos(at(i)), Stamp::from_nanos(real))
        })
        .collect()
}

#[test]
fn too_few_frames_are_an_error() {
    let found = FramePairs::check(&good(5)).unwrap_err();
    assert_eq!(found, ClockError::TooFewFrames { found: 5, needed: 8 });
    assert!(FramePairs::<Unix, PiSensor>::check(&[]).is_err());
    assert!(paper_interval(&good(1), PaperUnit::Microseconds).is_err());
}

#[test]
fn duplicates_and_frames_out_of_order_are_left_out_and_counted() {
    let mut pairs = good(200);
    pairs[40].sensor = pairs[39].sensor;
    pairs[80].sensor = pairs[80].sensor + Span::from_secs_f64(3_600.0);
    pairs.swap(120, 121);
    let checked = FramePairs::check(&pairs).unwrap();
    let tally = checked.tally();
    assert_eq!((tally.n_duplicate, tally.n_out_of_order, tally.n_too_early), (1, 2, 0));
    assert_eq!(tally.n_seen, tally.n_kept + 3);
    assert!(checked.pairs().windows(2).all(|pair| pair[0].sensor < pair[1].sensor));
}

#[test]
fn a_sensor_clock_that_begins_again_is_an_error_that_states_where() {
    let mut pairs = good(200);
    let back = pairs[120].sensor - Stamp::from_nanos(1_000);
    pairs[120..].iter_mut().for_each(|pair| pair.sensor = pair.sensor - back);
    let found = FramePairs::check(&pairs).unwrap_err();
    assert!(
        matches!(found, ClockError::SensorOrder { frame: 120, n_bad: 80, n: 200, .. }),
        "{found}"
    );
}

#[test]
fn microseconds_taken_for_nanoseconds_are_an_error_that_states_it() {
    let mut pairs = good(100);
    for pair in &mut pairs {
        pair.sensor = Stamp::from_nanos(pair.sensor.as_micros());
    }
    let found = FramePairs::check(&pairs).unwrap_err();
    assert!(found.to_string().contains("microseconds"), "{found}");
}

#[test]
fn a_misread_real_time_does_not_become_the_smallest_latency() {
    let mut pairs = good(400);
    pairs[150].real = pairs[150].real - Span::from_secs_f64(86_400.0);
    pairs[0].real = pairs[0].real - Span::from_secs_f64(1.0);
    let checked = FramePairs::check(&pairs).unwrap();
    assert_eq!(checked.tally().n_too_early, 2);
    let found = envelope(&checked, &EnvelopeOptions::default()).unwrap();
    let at = pairs[200].sensor;
    let smallest =
        good(400)[1..].iter().map(|pair| pair.real.as_nanos() - pair.sensor.as_nanos()).min();
    assert_eq!(Some(found.map(at).unwrap().as_nanos() - at.as_nanos()), smallest);
    assert_eq!(found.n_steps(), 0);
}

#[test]
fn stamps_at_the_ends_of_their_range_do_not_panic() {
    let far: Vec<FramePair> = (0..40)
        .map(|i| FramePair::new(Stamp::from_nanos(i64::MIN + i), Stamp::from_nanos(i64::MAX - i)))
        .collect();
    if let Ok(pairs) = FramePairs::check(&far) {
        assert!(envelope(&pairs, &EnvelopeOptions::default()).is_ok());
        assert!(hull(&pairs, MinimumLatency::Unknown).is_ok());
        assert!(olson2(&pairs, 50.0, MinimumLatency::Unknown).is_ok());
    }
    assert!(paper_interval(&far, PaperUnit::Nanoseconds).is_ok());
}
