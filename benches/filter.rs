//! Speed of filtering events by a moving region: `cargo bench --bench filter`.
//!
//! Ten million events over the whole DAVIS346, one per 100 ns, and a target image of 83 pixels that
//! circles and rotates, its path sampled at 1 ms; and as many events that are all inside it.
//! Reports events per second of the thread's processor time, which other programs affect little,
//! and the ratio of that time to a copy of the same four columns.

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)]

use evrig::event::{Event, Events};
use evrig::filter::region::{RegionPath, RegionSetting, filter};
use evrig::geometry::{Homography, Size};
use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;

const N_EVENTS: u64 = 10_000_000;
const N_ROUNDS: usize = 7;

/// From pixels to the target image at a time.
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

/// Over the whole sensor, or near the centre of the path, where they are always inside the image.
fn events(everywhere: bool) -> Events {
    let event = |i: u64| {
        let draw = i.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(23);
        let [x, y] = match everywhere {
            true => [(draw % 346) as u16, (draw >> 32) as u16 % 260],
            false => [165 + (draw % 10) as u16, 115 + (draw >> 32) as u16 % 10],
        };
        Event { t: (i / 10) as i64, x, y, on: draw & 64 == 0 }
    };
    (0..N_EVENTS).map(event).collect()
}

/// Processor time of this thread, seconds.
fn thread_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Median seconds of some rounds.
fn seconds(mut work: impl FnMut()) -> f64 {
    let mut rounds: Vec<f64> = (0..N_ROUNDS)
        .map(|_| {
            let started = thread_s();
            work();
            thread_s() - started
        })
        .collect();
    rounds.sort_by(f64::total_cmp);
    rounds[N_ROUNDS / 2]
}

fn main() {
    let (events, inside) = (events(true), events(false));
    let path = RegionPath::new(Size::DAVIS346, [0, 1_000_000], 1_000, square, None).unwrap();
    let same = |p: [f64; 2]| Some(p);
    let through_lens =
        RegionPath::new(Size::DAVIS346, [0, 1_000_000], 1_000, square, Some(&same)).unwrap();
    let copy = seconds(|| drop(black_box(black_box(events.as_slice()).to_events())));
    let rate = |seconds: f64| N_EVENTS as f64 / seconds * 1e-6;
    println!("{N_EVENTS} events, one thread, median of {N_ROUNDS}");
    println!("| what | million events/s | time over a copy's |\n| --- | --- | --- |");
    println!("| copy of the columns | {:.0} | 1 |", rate(copy));
    let crop = RegionSetting { crop_px: Some(88), ..RegionSetting::default() };
    for (name, events, path, setting) in [
        ("region", &events, &path, RegionSetting::default()),
        ("region, cropped to 88 px", &events, &path, crop),
        ("region through a lens", &events, &through_lens, RegionSetting::default()),
        ("region, all events in it", &inside, &path, RegionSetting::default()),
    ] {
        let spent = seconds(|| {
            black_box(filter(black_box(events.as_slice()), path, setting).unwrap());
        });
        println!("| {name} | {:.0} | {:.1} |", rate(spent), spent / copy);
    }
}
