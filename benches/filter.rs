//! How fast events are held against a moving region: `cargo bench --bench filter`.
//!
//! Ten million events all over a DAVIS346, one each 100 ns, and a picture of 83 pixels that circles
//! and turns, its path at 1 ms. Reported: events a second on one thread, and the ratio of its time to
//! a copy of the same four columns.

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)]

use evrig::event::{Event, Events};
use evrig::filter::region::{RegionPath, Setting, filter};
use evrig::geometry::{Homography, Size};
use std::hint::black_box;
use std::time::Instant;

const N_EVENTS: u64 = 10_000_000;
const N_ROUNDS: usize = 7;

/// From pixels to the picture at a time.
fn square(t_us: i64) -> Option<Homography> {
    let angle = t_us as f64 * 3e-6;
    let [x, y] = [170.0 + 30.0 * angle.cos(), 120.0 + 30.0 * angle.sin()];
    let (sin, cos) = (0.4 * angle).sin_cos();
    let (sin, cos) = (sin / 83.0, cos / 83.0);
    Some(Homography::from([
        [cos, sin, 0.5 - cos * x - sin * y],
        [-sin, cos, 0.5 + sin * x - cos * y],
        [1e-6, 0.0, 1.0],
    ]))
}

fn events() -> Events {
    let event = |i: u64| {
        let draw = i.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(23);
        let [x, y] = [(draw % 346) as u16, (draw >> 32) as u16 % 260];
        Event { t: (i / 10) as i64, x, y, on: draw & 64 == 0 }
    };
    (0..N_EVENTS).map(event).collect()
}

/// Median seconds of some rounds.
fn seconds(mut work: impl FnMut()) -> f64 {
    let mut rounds: Vec<f64> = (0..N_ROUNDS)
        .map(|_| {
            let started = Instant::now();
            work();
            started.elapsed().as_secs_f64()
        })
        .collect();
    rounds.sort_by(f64::total_cmp);
    rounds[N_ROUNDS / 2]
}

fn main() {
    let events = events();
    let path = RegionPath::new(Size::DAVIS346, [0, 1_000_000], 1_000, square, None).unwrap();
    let same = |p: [f64; 2]| Some(p);
    let through_lens =
        RegionPath::new(Size::DAVIS346, [0, 1_000_000], 1_000, square, Some(&same)).unwrap();
    let copy = seconds(|| drop(black_box(black_box(events.as_slice()).to_events())));
    let rate = |seconds: f64| N_EVENTS as f64 / seconds * 1e-6;
    println!("{N_EVENTS} events, one thread, median of {N_ROUNDS}");
    println!("| what | million events/s | time over a copy's |\n| --- | --- | --- |");
    println!("| copy of the columns | {:.0} | 1 |", rate(copy));
    let crop = Setting { crop_px: Some(88), ..Setting::default() };
    for (name, path, setting) in [
        ("region", &path, Setting::default()),
        ("region, cropped to 88 px", &path, crop),
        ("region through a lens", &through_lens, Setting::default()),
    ] {
        let spent = seconds(|| {
            black_box(filter(black_box(events.as_slice()), path, setting).unwrap());
        });
        println!("| {name} | {:.0} | {:.1} |", rate(spent), spent / copy);
    }
}
