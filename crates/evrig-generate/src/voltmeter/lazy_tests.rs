//! The fast form against the law and against the plain form, through whole frames.

use super::*;
use crate::grid::{FramePixelModel, PixelGrid};
use crate::random::RandomSource;
use crate::{Generator, VoltmeterLaw, ks};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_core::stats::Moments;

const SPAN_US: i64 = 8_333;
const SIZE: Size = Size::new(100, 90);

/// Per pixel, the times (µs since the first frame) and sides of its events.
type Trains = Vec<Vec<(i64, bool)>>;

fn push(generator: &mut dyn Generator, i: i64, brightness: f32, trains: &mut Trains) {
    let start = 1_700_000_000_000_000;
    let values = vec![brightness; SIZE.n_pixels()];
    let mut out = Events::new();
    let frame = Luminance { t_us: start + i * SPAN_US, size: SIZE, values };
    generator.push(&frame, &mut out).unwrap();
    for event in out.as_slice().iter() {
        trains[SIZE.index(event.x, event.y)].push((event.t - start, event.on));
    }
}

fn no_trains() -> Trains {
    vec![Vec::new(); SIZE.n_pixels()]
}

/// k whose drift and noise do not depend on brightness: b = μ/σ² and s = σ²τ.
fn steady(b: f64, s: f64) -> Coefficients {
    let rate = s / SPAN_US as f64;
    Coefficients::new([0.0, 1.0, 0.0, b * rate, 0.0, rate.sqrt()]).unwrap()
}

#[test]
fn the_fast_form_follows_the_two_barrier_law_over_drift_noise_and_frame_rate() {
    // b = 5, 12 and 30 pass between the general way and the one along the drift.
    for (b, s) in [
        (0.0, 0.0083),
        (0.1, 0.1),
        (-1.0, 0.0083),
        (1.0, 0.1),
        (5.0, 0.02),
        (-12.0, 0.003),
        (12.0, 0.1),
        (30.0, 0.01),
        (-300.0, 1e-4),
        (3_000.0, 1e-6),
    ] {
        let k = steady(b, s);
        let motion = k.motion(1.0, 1.0, SPAN_US as f64);
        let mut generator = PixelGrid::new(LazyVoltmeter::new(k, 5), None).unwrap();
        let mut trains = no_trains();
        let mut i = 0;
        // A fixed number of events from each pixel, and no window, leaves no length bias.
        while trains.iter().any(|train| train.len() < 2) {
            push(&mut generator, i, 1.0, &mut trains);
            i += 1;
        }
        let times: Vec<f64> = trains
            .iter()
            .flat_map(|train| [train[0].0, train[1].0 - train[0].0])
            .map(|t| t as f64)
            .collect();
        // Event times are whole microseconds, rounded up: the middle of the cell, half earlier.
        let shifted = trains.iter().map(|train| train[0].0 as f64 - 0.5);
        ks::assert_law(shifted, |t| 1.0 - closed_form::survival(0.0, motion, t));
        let sample: Moments = times.iter().copied().collect();
        let (mean, sd) =
            (closed_form::mean_interval_us(motion), closed_form::sd_interval_us(motion));
        let error = sd / (times.len() as f64).sqrt();
        assert!(
            (sample.mean() - mean).abs() < 3.89 * error + 0.5,
            "{b} {s}: {} {mean}",
            sample.mean()
        );
        let n_on = trains.iter().map(|train| usize::from(train[0].1)).sum();
        ks::assert_share(n_on, trains.len(), closed_form::probability_on(0.0, motion));
    }
}

/// What pixels do while brightness swings from frame to frame.
struct SwingCase {
    first_us: Vec<f64>,
    last_us: Vec<f64>,
    n_on: Vec<f64>,
    n_off: Vec<f64>,
    end: Vec<f64>,
}

fn swing<M: FramePixelModel>(model: M, end: impl Fn(&M::State) -> Vec<f64>) -> SwingCase {
    let mut generator = PixelGrid::new(model, None).unwrap();
    let mut trains = no_trains();
    for i in 0..25 {
        let brightness = 400.0 + 250.0 * (0.8 * i as f32).sin();
        push(&mut generator, i, brightness, &mut trains);
    }
    let count = |side| {
        let of = move |train: &Vec<(i64, bool)>| train.iter().filter(|(_, on)| *on == side).count();
        trains.iter().map(of).map(|n| n as f64).collect()
    };
    let time = |at: Option<&(i64, bool)>| at.map_or(0.0, |(t, _)| *t as f64);
    SwingCase {
        first_us: trains.iter().map(|train| time(train.first())).collect(),
        last_us: trains.iter().map(|train| time(train.last())).collect(),
        n_on: count(true),
        n_off: count(false),
        end: generator.states().flat_map(end).collect(),
    }
}

#[test]
fn the_fast_form_and_the_plain_form_do_the_same_to_swinging_brightness() {
    let noisy = Coefficients::new([1.5, 2.0, 1e-2, 1e-6, 1e-9, 1e-4]).unwrap();
    for k in [Coefficients::RAW2DVS346, noisy] {
        let plain = swing(ScalarVoltmeter::new(k, VoltmeterLaw::Exact, 6), Vec::clone);
        let mut draws = RandomSource::new(7).draws(0, 0);
        let drawn = std::cell::RefCell::new(move || draws.normal());
        let fast = swing(LazyVoltmeter::new(k, 8), |state| {
            let drawn = &mut *drawn.borrow_mut();
            let all = state.all_moments().into_iter();
            all.map(|moments| moments.mean + moments.variance.sqrt() * drawn()).collect()
        });
        ks::assert_same_law(&plain.first_us, &fast.first_us);
        ks::assert_same_law(&plain.last_us, &fast.last_us);
        ks::assert_same_law(&plain.end, &fast.end);
        for (plain, fast) in [(&plain.n_on, &fast.n_on), (&plain.n_off, &fast.n_off)] {
            let moments = |counts: &Vec<f64>| counts.iter().copied().collect::<Moments>();
            let (plain, fast) = (moments(plain), moments(fast));
            let error = plain.standard_error().hypot(fast.standard_error());
            assert!(plain.mean() > 1.0, "the case is a weak one");
            assert!((plain.mean() - fast.mean()).abs() <= 3.89 * error, "{plain:?} {fast:?}");
        }
    }
}

#[test]
fn a_pixel_that_does_not_fire_ends_where_the_law_given_no_event_predicts() {
    // Each way to end an interval: noise alone, both barriers near, drift that nearly arrives
    // (with and without a past in which nothing was drawn).
    for (b, s, n_intervals) in
        [(0.0, 0.3, 1), (2.0, 0.2, 1), (-20.0, 0.05, 1), (-40.0, 0.025, 1), (40.0, 0.0083, 3)]
    {
        let k = steady(b, s);
        let motion = k.motion(1.0, 1.0, SPAN_US as f64);
        let mut generator = PixelGrid::new(LazyVoltmeter::new(k, 15), None).unwrap();
        let mut trains = no_trains();
        (0..=n_intervals).for_each(|i| push(&mut generator, i, 1.0, &mut trains));
        let mut draws = RandomSource::new(16).draws(0, 0);
        let ends: Vec<f64> = generator
            .states()
            .flat_map(Voltages::all_moments)
            .zip(&trains)
            .filter(|(_, train)| train.is_empty())
            .map(|(moments, _)| moments.mean + moments.variance.sqrt() * draws.normal())
            .collect();
        let span_us = (n_intervals * SPAN_US) as f64;
        let alive = closed_form::survival(0.0, motion, span_us);
        ks::assert_share(ends.len(), trains.len(), alive);
        let below = |z| closed_form::residual_mass(0.0, motion, span_us, z) / alive;
        ks::assert_law(ends, below);
    }
}
