//! Each mechanism of the v2e pixel shows as it should.

use super::*;
use crate::Generator;
use crate::grid::PixelGrid;
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_core::stats::Moments;

const SIZE: Size = Size::new(100, 50);

/// All pixels see `brightness(t)` at 1,000 frames a second for `n` frames.
fn run(parameters: V2eParameters, n: u32, brightness: impl Fn(f64) -> f64) -> Events {
    let mut generator = PixelGrid::new(V2e::new(parameters, 9), None).unwrap();
    let mut out = Events::new();
    for i in 0..=n {
        let values = vec![brightness(f64::from(i) * 1e-3) as f32; SIZE.n_pixels()];
        let frame = Luminance { t_us: 1_000 * i64::from(i), size: SIZE, values };
        generator.push(&frame, &mut out).unwrap();
    }
    out
}

fn ideal() -> V2eParameters {
    V2eParameters { threshold_sd: 0.0, ..V2eParameters::CLEAN }
}

#[test]
fn a_step_fires_as_often_as_the_threshold_fits_into_its_logarithm() {
    let out = run(ideal(), 2, |t| if t < 0.5e-3 { 50.0 } else { 150.0 });
    // ln 3 = 1.0986: five thresholds of 0.2, evenly over the first interval.
    let of_pixel: Vec<i64> =
        out.as_slice().iter().filter(|e| (e.x, e.y) == (7, 7)).map(|e| e.t).collect();
    assert_eq!(of_pixel, [200, 400, 600, 800, 1_000]);
    assert_eq!(out.len(), 5 * SIZE.n_pixels());
    assert_eq!(out.as_slice().count_on(), out.len());
}

#[test]
fn dark_brightness_counts_linearly() {
    // From 2 to 12 of 255 below the edge of 20: 10 ln(20)/20 = 1.4979, seven thresholds; the
    // logarithm alone would give ln 6 = 1.79, eight.
    let out = run(ideal(), 2, |t| if t < 0.5e-3 { 2.0 } else { 12.0 });
    assert_eq!(out.len(), 7 * SIZE.n_pixels());
}

#[test]
fn the_low_pass_delays_more_in_the_dark() {
    let parameters = V2eParameters { cutoff_hz: 10.0, ..ideal() };
    // The same contrast at two lights: time of the third ON event after the step.
    let third = |dark: f64| {
        let out = run(parameters, 400, |t| if t < 0.5e-3 { dark } else { dark * 2.2 });
        let times = out.as_slice().iter().filter(|e| (e.x, e.y) == (0, 0)).map(|e| e.t);
        times.take(3).last().unwrap() as f64
    };
    // A first-order low-pass passes 0.6 of ln 2.2 after τ ln(1/(1 − 0.6/0.788)); its rate is 2π 10
    // Hz times (light + 20)/275.
    let expected = |bright: f64| {
        let tau = 1.0 / (std::f64::consts::TAU * 10.0 * (bright + 20.0) / 275.0);
        -tau * (1.0_f64 - 0.6 / 2.2_f64.ln()).ln() * 1e6
    };
    for dark in [25.0, 100.0] {
        let (found, exact) = (third(dark), expected(dark * 2.2));
        assert!((found - exact).abs() < 2_000.0, "{dark}: {found} us, expected {exact} us");
    }
}

#[test]
fn the_leak_fires_on_at_its_rate_and_not_all_pixels_at_once() {
    let parameters = V2eParameters { leak_rate_hz: 4.0, ..ideal() };
    let out = run(parameters, 2_000, |_| 100.0);
    assert_eq!(out.as_slice().count_on(), out.len());
    let rate = out.len() as f64 / 2.0 / SIZE.n_pixels() as f64;
    assert!((rate - 4.0).abs() < 0.05, "{rate} Hz");
    let early = out.as_slice().between(0, 125_000).len() as f64 / SIZE.n_pixels() as f64;
    assert!((early - 0.5).abs() < 0.05, "{early} events a pixel in half a period");
}

#[test]
fn shot_noise_is_balanced_random_and_stronger_in_the_dark() {
    let parameters = V2eParameters { shot_noise_rate_hz: 20.0, ..ideal() };
    let seconds = 0.5;
    let rate = |relative_light: f64| {
        let out = run(parameters, 500, |_| relative_light);
        let n = out.len() as f64;
        let on = out.as_slice().count_on() as f64;
        assert!((on - 0.5 * n).abs() < 3.89 * 0.5 * n.sqrt(), "{on} On of {n}");
        // Counts of a Poisson process: variance over pixels equals the mean.
        let mut counts = vec![0.0; SIZE.n_pixels()];
        out.as_slice().iter().for_each(|e| counts[SIZE.index(e.x, e.y)] += 1.0);
        let counts: Moments = counts.into_iter().collect();
        let fano = counts.variance() / counts.mean();
        // Its standard error over 5,000 pixels is 0.02.
        assert!((fano - 1.0).abs() < 0.08, "{fano}");
        counts.mean() / seconds
    };
    // 20 Hz times 1 − 0.75 (light + 20)/275.
    for relative_light in [0.0, 255.0] {
        let exact = 20.0 * (1.0 - 0.75 * (relative_light + 20.0) / 275.0);
        assert!(
            (rate(relative_light) / exact - 1.0).abs() < 0.03,
            "{} {exact}",
            rate(relative_light)
        );
    }
}

#[test]
fn mismatch_makes_pixels_fire_differently_often_at_the_same_step() {
    let parameters = V2eParameters { threshold_sd: 0.02, ..ideal() };
    let out = run(parameters, 1, |t| 20.5 * (12.0 * t.min(1e-3) / 1e-3 * 0.2).exp());
    let mut counts = vec![0.0; SIZE.n_pixels()];
    out.as_slice().iter().for_each(|e| counts[SIZE.index(e.x, e.y)] += 1.0);
    let counts: Moments = counts.into_iter().collect();
    // 2.4 log units over 0.2 ± 0.02: 12 − ½ (floor) + 0.12 (mean of 1/threshold), ± 1.2.
    assert!((counts.mean() - 11.62).abs() < 0.15, "{}", counts.mean());
    assert!((counts.standard_deviation() - 1.3).abs() < 0.15, "{}", counts.standard_deviation());
}

#[test]
fn silence_lasts_the_refractory_period() {
    let parameters = V2eParameters { refractory_us: 700.0, shot_noise_rate_hz: 500.0, ..ideal() };
    let out = run(parameters, 200, |_| 0.0);
    let mut last = vec![i64::MIN / 2; SIZE.n_pixels()];
    let mut shortest = i64::MAX;
    for event in out.as_slice().iter() {
        let i = SIZE.index(event.x, event.y);
        shortest = shortest.min(event.t - last[i]);
        last[i] = event.t;
    }
    assert!((699..=705).contains(&shortest), "{shortest}");
}

#[test]
fn wrong_parameters_are_named() {
    let wrong = V2eParameters { leak_rate_hz: -1.0, ..V2eParameters::NOISY };
    assert!(wrong.check().unwrap_err().to_string().contains("leak_rate_hz"));
    assert!(V2eParameters::NOISY.check().is_ok() && V2eParameters::CLEAN.check().is_ok());
}
