//! A square planted in motion comes back, event by event.

use super::*;
use evrig_core::event::Event;
use proptest::prelude::*;

const SIZE: Size = Size::new(346, 260);
const SIDE: f64 = 80.0;

/// Middle and turn of a square that goes round and turns.
fn truth(t_us: f64) -> ([f64; 2], f64) {
    let angle = t_us * 3e-6;
    ([170.0 + 30.0 * angle.cos(), 120.0 + 30.0 * angle.sin()], 0.4 * angle)
}

/// Where on the square (0..1) a place in the frame lies.
fn on_square(t_us: f64, [px, py]: [f64; 2]) -> [f64; 2] {
    let ([x, y], turn) = truth(t_us);
    let ([dx, dy], (sin, cos)) = ([px - x, py - y], turn.sin_cos());
    [(cos * dx + sin * dy) / SIDE + 0.5, (-sin * dx + cos * dy) / SIDE + 0.5]
}

fn homography(t_us: i64) -> Homography {
    let ([x, y], turn) = truth(t_us as f64);
    let (sin, cos) = (turn.sin() / SIDE, turn.cos() / SIDE);
    Homography::from([
        [cos, sin, 0.5 - cos * x - sin * y],
        [-sin, cos, 0.5 + sin * x - cos * y],
        [0.0, 0.0, 1.0],
    ])
}

fn path() -> RegionPath {
    RegionPath::new(SIZE, [0, 2_000_000], 1_000, |t| Some(homography(t)), None).unwrap()
}

/// One event each 37 us somewhere on the sensor.
fn events() -> Events {
    (0..50_000_u64)
        .map(|i| {
            let draw = i.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(23);
            let [x, y] = [(draw % 346) as u16, (draw >> 32) as u16 % 260];
            Event { t: i as i64 * 37, x, y, on: draw & 64 == 0 }
        })
        .collect()
}

fn place(event: &Event) -> [f64; 2] {
    on_square(event.t as f64, [f64::from(event.x) + 0.5, f64::from(event.y) + 0.5])
}

#[test]
fn events_within_the_moving_square_and_its_margin_stay_and_no_others() {
    let (events, setting) = (events(), RegionSetting::default());
    let found = filter(events.as_slice(), &path(), setting).unwrap();
    assert!(found.tally.balances() && found.tally.seen == 50_000);
    // A place within 0.001 px of the edge may fall either way in single precision.
    let inside = |slack: f64| {
        let keep = move |e: &Event| place(e).iter().all(|p| (p - 0.5).abs() <= 0.53 + slack / SIDE);
        events.as_slice().iter().filter(keep).collect::<Vec<Event>>()
    };
    let (least, most) = (inside(-1e-3), inside(1e-3));
    let kept: Vec<Event> = found.events.as_slice().iter().collect();
    assert!(least.len() <= kept.len() && kept.len() <= most.len());
    let most: std::collections::HashSet<Event> = most.into_iter().collect();
    assert!(kept.iter().all(|event| most.contains(event)));
    assert!(kept.len() > 3_000, "about a twelfth of the sensor: {}", kept.len());
    assert_eq!(found.tally.dropped[&DropReason::OutsideRegion], 50_000 - kept.len() as u64);
}

#[test]
fn a_crop_of_any_size_has_the_events_where_the_square_has_them() {
    for crop in [1_u16, 33, 200] {
        let setting = RegionSetting { margin: 0.03, crop_px: Some(crop) };
        let found = filter(events().as_slice(), &path(), setting).unwrap();
        let plain = filter(events().as_slice(), &path(), RegionSetting::default()).unwrap();
        assert_eq!(found.tally, plain.tally, "the crop does not change what is kept");
        for (moved, own) in found.events.as_slice().iter().zip(plain.events.as_slice().iter()) {
            let expected = place(&own).map(|p| (p + 0.03) / 1.06 * f64::from(crop));
            for (px, expected) in [moved.x, moved.y].into_iter().zip(expected) {
                let off = f64::from(px) + 0.5 - expected;
                assert!(off.abs() <= 0.5 + 1e-3 * f64::from(crop), "{moved:?} {expected}");
            }
        }
    }
}

#[test]
fn events_at_times_without_a_path_are_counted_by_themselves() {
    let gap = 500_000..900_000;
    let known = |t: i64| (!gap.contains(&t)).then(|| homography(t));
    let path = RegionPath::new(SIZE, [100_000, 1_500_000], 1_000, known, None).unwrap();
    let found = filter(events().as_slice(), &path, RegionSetting::default()).unwrap();
    assert!(found.tally.balances());
    let is_kept = |t: &i64| (100_000..499_000).contains(t) || (900_000..1_501_000).contains(t);
    assert!(found.events.as_slice().t.iter().all(is_kept));
    let n_known = events().as_slice().t.iter().filter(|t| is_kept(t)).count();
    assert_eq!(found.tally.dropped[&DropReason::NoPath], 50_000 - n_known as u64);
}

#[test]
fn a_lens_that_bends_moves_the_region_with_it() {
    // A lens that only scales about the frame's middle is a homography again: both must agree.
    let scale = 1.25;
    let middle = [173.0, 130.0];
    let ideal = |[x, y]: [f64; 2]| {
        Some([middle[0] + scale * (x - middle[0]), middle[1] + scale * (y - middle[1])])
    };
    let bent = RegionPath::new(SIZE, [0, 2_000_000], 1_000, |t| Some(homography(t)), Some(&ideal))
        .unwrap();
    let found = filter(events().as_slice(), &bent, RegionSetting::default()).unwrap();
    let inside = |e: &Event| {
        let there = ideal([f64::from(e.x) + 0.5, f64::from(e.y) + 0.5]).unwrap();
        on_square(e.t as f64, there).iter().all(|p| (p - 0.5).abs() <= 0.53 + 1e-4)
    };
    assert!(found.events.len() > 2_000);
    assert!(found.events.as_slice().iter().all(|event| inside(&event)));
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let none = Events::new();
    for setting in [
        RegionSetting { margin: -0.1, crop_px: None },
        RegionSetting { margin: f64::NAN, crop_px: None },
        RegionSetting { margin: 0.0, crop_px: Some(0) },
    ] {
        assert!(filter(none.as_slice(), &path(), setting).is_err());
    }
    let never = |_: i64| None;
    assert!(RegionPath::new(SIZE, [0, 10], 0, never, None).is_err());
    assert!(RegionPath::new(SIZE, [10_000, 0], 1, never, None).is_err());
    assert!(RegionPath::new(SIZE, [0, i64::MAX], 1, never, None).is_err());
}

proptest! {
    #[test]
    fn whatever_the_times_every_event_has_a_fate(times in prop::collection::vec(any::<i64>(), 0..40)) {
        let mut times = times;
        times.sort_unstable();
        let events: Events = times.iter().map(|&t| Event { t, x: 170, y: 130, on: true }).collect();
        let found = filter(events.as_slice(), &path(), RegionSetting::default()).unwrap();
        prop_assert!(found.tally.balances());
    }
}
