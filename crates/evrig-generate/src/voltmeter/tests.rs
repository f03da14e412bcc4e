//! The event model as frames see it.

use super::*;
use crate::grid::PixelGrid;
use crate::{GenerateError, Generator, VoltmeterLaw};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use std::num::NonZeroUsize;

const START_US: i64 = 1_700_000_000_000_000;
const SIZE: Size = Size::new(100, 90);

fn frame(t_us: i64, size: Size, brightness: impl Fn(u16, u16) -> f32) -> Luminance {
    let pixels = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
    Luminance { t_us, size, values: pixels.map(|(x, y)| brightness(x, y)).collect() }
}

fn grating(i: u16) -> Luminance {
    let phase = |x: u16, y: u16| 0.2 * f32::from(x + 2 * i) + 0.1 * f32::from(y);
    frame(START_US + 8_333 * i64::from(i), SIZE, |x, y| 500.0 + 400.0 * phase(x, y).sin())
}

type Made = Box<dyn Generator>;

/// All ways to run the model, over `threads` threads and blocks of `block` pixels.
const WAYS: [fn(u64, usize, usize) -> Made; 3] = [
    |seed, threads, block| {
        let model = LazyVoltmeter::new(Coefficients::RAW2DVS346, seed);
        made(model, threads, block)
    },
    |seed, threads, block| made(raw_scalar(VoltmeterLaw::Exact, seed), threads, block),
    |seed, threads, block| made(raw_scalar(VoltmeterLaw::Reference, seed), threads, block),
];

fn raw_scalar(law: VoltmeterLaw, seed: u64) -> ScalarVoltmeter {
    ScalarVoltmeter::new(Coefficients::RAW2DVS346, law, seed)
}

fn made<M: crate::grid::FramePixelModel + 'static>(model: M, threads: usize, block: usize) -> Made {
    Box::new(PixelGrid::new(model, NonZeroUsize::new(threads)).unwrap().with_block_pixels(block))
}

fn run(generator: &mut dyn Generator, frames: impl IntoIterator<Item = Luminance>) -> Events {
    let mut out = Events::new();
    frames.into_iter().for_each(|frame| generator.push(&frame, &mut out).unwrap());
    out
}

#[test]
fn events_lie_in_their_interval_ordered_by_time_row_and_column() {
    for way in WAYS {
        let mut generator = way(1, 2, 4096);
        for i in 0..5 {
            let out = run(&mut *generator, [grating(i)]);
            let events = out.as_slice();
            let start = START_US + 8_333 * (i64::from(i) - 1);
            assert!(events.iter().all(|event| event.t > start && event.t <= start + 8_333));
            let key = |event: evrig_core::event::Event| (event.t, event.y, event.x);
            assert!(events.iter().zip(events.iter().skip(1)).all(|(a, b)| key(a) <= key(b)));
            assert!(events.first_outside(SIZE).is_none());
            assert_eq!(i > 0, events.len() > 1_000, "frame {i}: {} events", events.len());
        }
    }
}

#[test]
fn threads_and_chunks_do_not_change_the_events_and_seeds_do() {
    for way in WAYS {
        let events =
            |seed, threads, block| run(&mut *way(seed, threads, block), (0..6).map(grating));
        let one = events(1, 1, 4096);
        for (threads, block) in [(2, 4096), (1, 1), (2, 37), (2, 64), (1, 100_000)] {
            assert_eq!(events(1, threads, block), one, "{threads} threads, blocks of {block}");
        }
        assert_ne!(events(2, 1, 4096), one);
    }
}

#[test]
fn where_drift_dominates_all_ways_give_as_many_events_within_a_thousandth() {
    let [fast, plain, published] =
        WAYS.map(|way| run(&mut *way(4, 2, 4096), (0..60).map(grating)).len() as f64);
    assert!(plain > 100_000.0, "{plain} events");
    assert!((fast / plain - 1.0).abs() < 1e-3, "{fast} {plain}");
    assert!((published / plain - 1.0).abs() < 1e-3, "{published} {plain}");
}

#[test]
fn a_bad_frame_is_named_and_changes_nothing() {
    let good = run(&mut *WAYS[0](1, 1, 4096), (0..4).map(grating));
    let mut generator = WAYS[0](1, 1, 4096);
    let mut out = run(&mut *generator, (0..2).map(grating));
    let bad = |change: fn(&mut Luminance)| {
        let mut frame = grating(2);
        change(&mut frame);
        frame
    };
    let cases: [(Luminance, &str); 9] = [
        (grating(1), "not later"),
        (grating(0), "not later"),
        (bad(|frame| frame.t_us = i64::MIN), "not later"),
        (bad(|frame| frame.t_us = i64::MAX), "check the unit"),
        (bad(|frame| frame.t_us += 90_000_000_000), "check the unit"),
        (frame(grating(2).t_us, Size::new(90, 100), |_, _| 1.0), "90 x 100"),
        (bad(|frame| frame.values.truncate(8_999)), "8999 values"),
        (bad(|frame| frame.values[250] = f32::NAN), "NaN at pixel (50, 2)"),
        (bad(|frame| frame.values[8_999] = -1.0), "-1 at pixel (99, 89)"),
    ];
    for (frame, expected) in cases {
        let error = generator.push(&frame, &mut out).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("frame 2"), "{error}");
    }
    for i in 2..4 {
        generator.push(&grating(i), &mut out).unwrap();
    }
    assert_eq!(out, good);
}

#[test]
fn k_that_fire_without_bound_are_refused_before_memory_runs_out() {
    let k = Coefficients::new([1e4, 1e-9, 0.0, 0.0, 0.0, 1.0]).unwrap();
    let mut generator = PixelGrid::new(LazyVoltmeter::new(k, 0), None).unwrap();
    let mut out = Events::new();
    generator.push(&grating(0), &mut out).unwrap();
    let error = generator.push(&grating(1), &mut out).unwrap_err().to_string();
    assert!(error.contains("may fire"), "{error}");
}

#[test]
fn dark_saturated_and_noise_free_pixels_give_finite_events() {
    let levels = [0.0, 1e-30, 1.0, 64.0, 1_023.0, 65_535.0, 1e30];
    let noise_free = Coefficients::new([2.388, 4.166e-7, 0.0, 0.0, 0.0, 0.0]).unwrap();
    for k in [Coefficients::RAW2DVS346, Coefficients::RGB2DVS346, Coefficients::DVS346, noise_free]
    {
        let scalar = |law| ScalarVoltmeter::new(k, law, 3);
        let voltages = |state: &Vec<f64>| state.clone();
        push_levels(scalar(VoltmeterLaw::Exact), &levels, voltages);
        push_levels(scalar(VoltmeterLaw::Reference), &levels, voltages);
        push_levels(LazyVoltmeter::new(k, 3), &levels, |state| {
            state.all_moments().into_iter().map(|moments| moments.mean).collect()
        });
    }
}

/// Every level after every other, then a microsecond later back, then still.
fn push_levels<M: crate::grid::FramePixelModel>(
    model: M,
    levels: &[f32; 7],
    voltages: impl Fn(&M::State) -> Vec<f64>,
) {
    let mut generator = PixelGrid::new(model, None).unwrap();
    let from = |t, x_wins: bool| {
        frame(t, Size::new(7, 7), |x, y| levels[usize::from(if x_wins { x } else { y })])
    };
    let mut out = Events::new();
    let frames = [from(0, true), from(8_333, false), from(8_334, true), from(9_000, true)];
    for frame in frames {
        if let Err(error) = generator.push(&frame, &mut out) {
            // Brightness of 1e30 under a leak in proportion to it fires without bound.
            assert!(matches!(error, GenerateError::TooManyEvents { .. }), "{error}");
        }
    }
    assert!(generator.states().flat_map(voltages).all(|v| v.abs() < 1.0));
}
