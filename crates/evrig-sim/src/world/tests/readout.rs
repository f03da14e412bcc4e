//! The effects behind the pixels, and the clocks.

use crate::world::test_world::{N_PIXELS, TestWorld};
use evrig_core::event::Event;

/// A step of light that makes every pixel fire about six times within 20 ms.
fn step() -> TestWorld {
    TestWorld::still("plain").light(0.0, 0.3).light(0.05, 1.0)
}

fn with(effects: &str) -> Vec<Event> {
    step().with(effects).events(1.0)
}

#[test]
fn a_full_bus_spreads_a_burst_and_loses_nothing() {
    let (free, full) = (with(""), with("readout_saturation = { max_events_per_s = 1e5 }"));
    assert_eq!(free.len(), full.len());
    let span = |events: &[Event]| events.last().unwrap().t - events[0].t;
    let expected = 1e6 * (full.len() as f64 - 1.0) / 1e5;
    assert!((span(&full) as f64 - expected).abs() < 0.1 * expected, "{} {expected}", span(&full));
    assert!(span(&free) < 25_000);
}

#[test]
fn rows_that_are_read_together_share_their_stamps() {
    let same_row_and_stamp = |events: &[Event]| {
        let pairs = events.windows(2);
        pairs.filter(|pair| pair[0].t == pair[1].t && pair[0].y == pair[1].y).count() as f64
            / events.len() as f64
    };
    let (free, rows) = (with(""), with("row_readout = { row_us = 20 }"));
    assert_eq!(free.len(), rows.len());
    assert!(same_row_and_stamp(&rows) > same_row_and_stamp(&free) + 0.3);
}

#[test]
fn what_is_dropped_is_a_share_and_jitter_loses_nothing() {
    let all = with("");
    let kept = with("event_drop = { fraction = 0.3 }").len() as f64 / all.len() as f64;
    assert!((kept - 0.7).abs() < 0.02, "{kept}");
    let jittered = with("stamp_jitter = { sigma_us = 500 }");
    assert_eq!(jittered.len(), all.len());
    let mean = |events: &[Event]| {
        events.iter().map(|event| event.t as f64).sum::<f64>() / events.len() as f64
    };
    assert!((mean(&jittered) - mean(&all)).abs() < 50.0);
    assert_ne!(jittered, all);
    assert!(jittered.windows(2).all(|pair| pair[0].t <= pair[1].t));
}

#[test]
fn the_cameras_own_frames_kick_its_pixels_row_after_row() {
    let coupled = "aps_coupling = { events_fraction = 0.1, delay_us = 300, row_us = 50 }";
    let events = TestWorld::still("plain").with(coupled).events(1.0);
    // Forty frames a second.
    let rate = events.len() as f64 / N_PIXELS;
    assert!((rate - 4.0).abs() < 0.2, "{rate}");
    for event in &events {
        let since_frame = event.t.rem_euclid(25_000);
        assert_eq!(since_frame, 300 + 50 * i64::from(event.y));
    }
    let mut without_frames = TestWorld::still("plain").with(coupled);
    without_frames.settings[0].aps = false;
    assert!(without_frames.events(1.0).is_empty());
}

#[test]
fn wrong_clocks_move_stamps_and_change_nothing_else() {
    let (right, late) = (with(""), with("clock_offset = { offset_us = 1500 }"));
    let fast = with("clock_skew = { skew_ppm = 1000 }");
    assert_eq!(right.len(), late.len());
    for ((right, late), fast) in right.iter().zip(&late).zip(&fast) {
        assert_eq!(late.t - right.t, 1_500);
        assert!((fast.t - right.t - right.t / 1_000).abs() <= 1);
    }
}

#[test]
fn lonely_events_do_not_pass_the_cameras_own_filter() {
    let activity = "background_activity = { rate_hz = 2 }";
    let lonely = TestWorld::still("plain").with(activity).events(1.0).len();
    let filtered = format!("{activity}\nsupport_filter = {{ window_us = 2000 }}");
    let passed = TestWorld::still("plain").with(&filtered).events(1.0).len();
    assert!(passed < lonely / 8, "{passed} of {lonely}");
}
