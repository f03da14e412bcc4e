//! The draws against the law: closed forms and a fine-step simulation of the same equation.

use super::*;
use crate::ks;
use crate::random::{CounterRng, RandomSource};
use evrig_core::stats::Moments;

type Advance = fn(f64, DriftDiffusion, f64, &mut CounterRng, &mut dyn FnMut(f64, bool)) -> f64;

/// 120 frames a second.
const SPAN_US: f64 = 1e6 / 120.0;

/// A motion of given b = μ/σ² and s = σ²τ.
fn scaled(b: f64, s: f64) -> DriftDiffusion {
    let rate = s / SPAN_US;
    DriftDiffusion { drift_per_us: b * rate, sigma_per_sqrt_us: rate.sqrt() }
}

/// Intervals between events in µs and their sides: `per_pixel` from each of `n_pixels`, frame by
/// frame.
fn intervals(
    advance: Advance,
    motion: DriftDiffusion,
    n_pixels: u32,
    per_pixel: usize,
) -> Vec<(f64, bool)> {
    let source = RandomSource::new(11);
    let mut all = Vec::new();
    for pixel in 0..n_pixels {
        let (mut v, mut last, mut n) = (0.0, 0.0, 0);
        for frame in 0.. {
            let mut draws = source.draws(pixel, frame);
            let start = frame as f64 * SPAN_US;
            v = advance(v, motion, SPAN_US, &mut draws, &mut |t, on| {
                // Taking a fixed number from each pixel, and no window, leaves no length bias.
                if n < per_pixel {
                    all.push((start + t - last, on));
                }
                last = start + t;
                n += 1;
            });
            if n >= per_pixel {
                break;
            }
        }
    }
    all
}

fn cv(sample: &Moments) -> f64 {
    sample.standard_deviation() / sample.mean()
}

/// Mean within 3.89 standard errors (false alarm 1e-4) and CV within a bound of the same size:
/// the errors of standard deviation and mean added, as if they never made up for each other.
#[track_caller]
fn assert_mean_and_cv(times: &[f64], motion: DriftDiffusion) {
    let sample: Moments = times.iter().copied().collect();
    let (mean, sd) = (closed_form::mean_interval_us(motion), closed_form::sd_interval_us(motion));
    let n = times.len() as f64;
    assert!((sample.mean() - mean).abs() < 3.89 * sd / n.sqrt(), "{} {mean}", sample.mean());
    let fourth: Moments = times.iter().map(|t| ((t - mean) / sd).powi(4)).collect();
    let relative = ((fourth.mean() - 1.0) / (4.0 * n)).sqrt() + sd / mean / n.sqrt();
    let (found, exact) = (cv(&sample), sd / mean);
    assert!((found / exact - 1.0).abs() < 3.89 * relative, "CV {found}, exact {exact}");
}

#[test]
fn intervals_follow_the_two_barrier_law_over_drift_noise_and_frame_rate() {
    for b in [0.0, 0.1, -0.5, 1.0, -2.0, 5.0, 30.0] {
        for s in [0.0083, 0.1, 1.0] {
            let motion = scaled(b, s);
            let sample = intervals(passage::advance, motion, 400, 20);
            let times: Vec<f64> = sample.iter().map(|(t, _)| *t).collect();
            ks::assert_law(times.iter().copied(), |t| 1.0 - closed_form::survival(0.0, motion, t));
            assert_mean_and_cv(&times, motion);
            let n_on = sample.iter().filter(|(_, on)| *on).count();
            let exact = 1.0 / (1.0 + (-2.0 * b).exp());
            ks::assert_share(n_on, sample.len(), exact);
            let of_side = |side| sample.iter().filter(move |(_, on)| *on == side).map(|(t, _)| *t);
            let (on, off): (Vec<f64>, Vec<f64>) =
                (of_side(true).collect(), of_side(false).collect());
            if on.len().min(off.len()) > 100 {
                // From 0 the time does not depend on the side.
                ks::assert_same_law(&on, &off);
            }
        }
    }
}

#[test]
fn the_residual_at_the_end_of_an_interval_follows_its_conditional_law() {
    let source = RandomSource::new(12);
    for b in [0.0, 2.0, -4.0] {
        for v in [0.0, 0.6, -0.7, 0.99] {
            for s in [0.02, 0.2, 1.0] {
                let motion = scaled(b, s);
                let (mut residuals, mut first, mut n_on) = (Vec::new(), Vec::new(), 0);
                let n = 8_000;
                for pixel in 0..n {
                    let mut draws = source.draws(pixel, 0);
                    let mut hit = None;
                    let end = passage::advance(v, motion, SPAN_US, &mut draws, &mut |t, on| {
                        hit.get_or_insert((t, on));
                    });
                    match hit {
                        None => residuals.push(end),
                        Some((t, on)) => {
                            first.push(t);
                            n_on += usize::from(on);
                        }
                    }
                }
                let alive = closed_form::survival(v, motion, SPAN_US);
                ks::assert_share(residuals.len(), n as usize, alive);
                if residuals.len() > 100 {
                    let below = |z| closed_form::residual_mass(v, motion, SPAN_US, z) / alive;
                    ks::assert_law(residuals.iter().copied(), below);
                }
                if first.len() > 100 {
                    let by = |t| (1.0 - closed_form::survival(v, motion, t)) / (1.0 - alive);
                    ks::assert_law(first.iter().copied(), by);
                }
                // All that will ever be hit from the residual is the rest of what is hit from v.
                let later: f64 =
                    residuals.iter().map(|&z| closed_form::probability_on(z, motion)).sum();
                let on = (n_on as f64 + later) / f64::from(n);
                let exact = closed_form::probability_on(v, motion);
                let error = (exact * (1.0 - exact) / f64::from(n)).sqrt();
                assert!((on - exact).abs() < 3.89 * error + 1e-12, "{b} {v} {s}: {on} {exact}");
            }
        }
    }
}

#[test]
fn the_published_presets_give_the_intervals_of_the_law_frame_by_frame() {
    // Mean (s) and CV of the interval for brightness and its change a frame; the values follow
    // from tanh(b)/μ and its variance, with four digits.
    let rows = [
        (Coefficients::RAW2DVS346, 400.0, 0.0, 9.658, 0.030_77),
        (Coefficients::RAW2DVS346, 400.0, 2.0, 0.6509, 0.007_988),
        (Coefficients::RAW2DVS346, 400.0, -2.0, 0.7523, 0.008_588),
        (Coefficients::RAW2DVS346, 400.0, 60.0, 0.023_21, 0.001_508),
        (Coefficients::RAW2DVS346, 64.0, 60.0, 0.003_721, 0.000_611),
        (Coefficients::DVS346, 128.0, 0.0, 1.351, 0.020_51),
        (Coefficients::DVS346, 128.0, 1.0, 0.1996, 0.007_884),
    ];
    for (k, mean, change, interval_s, cv) in rows {
        let (before, after) = (mean - 0.5 * change, mean + 0.5 * change);
        let motion = k.motion(before, after, SPAN_US);
        let exact = closed_form::mean_interval_us(motion);
        assert!((exact * 1e-6 / interval_s - 1.0).abs() < 3e-4, "{exact} {interval_s}");
        assert!((closed_form::sd_interval_us(motion) / exact / cv - 1.0).abs() < 3e-3, "{cv}");
        let sample = intervals(passage::advance, motion, 500, 2);
        let times: Vec<f64> = sample.iter().map(|(t, _)| *t).collect();
        assert_mean_and_cv(&times, motion);
        assert!(sample.iter().all(|(_, on)| *on == (motion.drift_per_us > 0.0)));
    }
}

/// Brightness of a pixel that swings, so that drift and noise change with every frame.
fn swing(frame: u32) -> f32 {
    100.0 + 60.0 * (0.9 * frame as f32).sin()
}

/// What one pixel does over ten frames of [`swing`]: first event, number of ON and OFF, last
/// voltage.
struct PassageOutcome {
    first_us: f64,
    n_on: f64,
    n_off: f64,
    end: f64,
}

fn outcome(
    pixel: u32,
    mut move_on: impl FnMut(f64, DriftDiffusion, &mut CounterRng, &mut dyn FnMut(f64, bool)) -> f64,
) -> PassageOutcome {
    let k = Coefficients::new([1.5, 2.0, 4e-3, 1e-6, 1e-9, 1e-4]).unwrap();
    let source = RandomSource::new(13);
    let mut outcome = PassageOutcome { first_us: f64::INFINITY, n_on: 0.0, n_off: 0.0, end: 0.0 };
    for frame in 0..10 {
        let motion = k.motion(swing(frame), swing(frame + 1), SPAN_US);
        let mut draws = source.draws(pixel, u64::from(frame));
        let start = f64::from(frame) * SPAN_US;
        let mut fire = |t: f64, on: bool| {
            outcome.first_us = outcome.first_us.min(start + t);
            outcome.n_on += f64::from(on);
            outcome.n_off += f64::from(!on);
        };
        outcome.end = move_on(outcome.end, motion, &mut draws, &mut fire);
    }
    outcome
}

/// Euler and Maruyama's scheme in `N_STEPS` a frame. Discrete sampling misses crossings; barriers
/// shifted inwards by 0.5826 σ√dt make up for it (Broadie, Glasserman and Kou, Math. Finance 7,
/// 1997), up to an error of the order of dt.
fn euler_maruyama(
    mut v: f64,
    motion: DriftDiffusion,
    draws: &mut CounterRng,
    fire: &mut dyn FnMut(f64, bool),
) -> f64 {
    const N_STEPS: u32 = 1_000;
    let dt = SPAN_US / f64::from(N_STEPS);
    let sd = motion.sigma_per_sqrt_us * dt.sqrt();
    let barrier = 1.0 - 0.5826 * sd;
    for i in 1..=N_STEPS {
        v += motion.drift_per_us * dt + sd * draws.normal();
        if v.abs() >= barrier {
            fire(f64::from(i) * dt, v > 0.0);
            v = 0.0;
        }
    }
    v
}

#[test]
fn a_swinging_pixel_does_what_a_fine_step_simulation_of_the_equation_does() {
    let n = 2_500;
    let fine: Vec<PassageOutcome> = (0..n).map(|pixel| outcome(pixel, euler_maruyama)).collect();
    let exact: Vec<PassageOutcome> = (n..5 * n)
        .map(|pixel| {
            outcome(pixel, |v, motion, draws, fire| {
                passage::advance(v, motion, SPAN_US, draws, fire)
            })
        })
        .collect();
    for of in [|o: &PassageOutcome| o.first_us, |o: &PassageOutcome| o.end] {
        let column = |outcomes: &[PassageOutcome]| outcomes.iter().map(of).collect::<Vec<f64>>();
        ks::assert_same_law(&column(&fine), &column(&exact));
    }
    for of in [|o: &PassageOutcome| o.n_on, |o: &PassageOutcome| o.n_off] {
        let moments = |outcomes: &[PassageOutcome]| outcomes.iter().map(of).collect::<Moments>();
        let (fine, exact) = (moments(&fine), moments(&exact));
        let error = fine.standard_error().hypot(exact.standard_error());
        assert!(fine.mean() > 0.3, "the case is a weak one: {}", fine.mean());
        assert!((fine.mean() - exact.mean()).abs() < 3.89 * error, "{fine:?} {exact:?}");
    }
}

#[test]
fn the_reference_law_departs_from_the_equation_where_the_published_program_does() {
    // Figures of the published program itself, run frame by frame: share of ON, mean (s) and CV.
    let rows = [
        (scaled(1.0, 0.0083), 1.0, 0.3839, 0.1974, 8_000),
        (scaled(1.0, 1.0), 0.8746, 0.005_745, 0.6647, 40_000),
        (Coefficients::RAW2DVS346.motion(400.0, 400.0, SPAN_US), 1.0, 9.601, 0.002_189, 400),
    ];
    for (motion, share_on, mean_s, program_cv, n) in rows {
        let sample = intervals(reference::advance, motion, n / 20, 20);
        let times: Moments = sample.iter().map(|(t, _)| *t * 1e-6).collect();
        let on = sample.iter().filter(|(_, on)| *on).count() as f64 / sample.len() as f64;
        assert!((on - share_on).abs() < 0.01, "{on} {share_on}");
        assert!((times.mean() / mean_s - 1.0).abs() < 0.02, "{} {mean_s}", times.mean());
        assert!((cv(&times) / program_cv - 1.0).abs() < 0.08, "{} {program_cv}", cv(&times));
    }
}

#[test]
fn the_published_shortcuts_are_refused_by_the_tests_of_the_law() {
    let motion = scaled(1.0, 0.0083);
    let sample = intervals(reference::advance, motion, 100, 20);
    let times = sample.iter().map(|(t, _)| *t);
    let (apart, n) = ks::distance(times, |t| 1.0 - closed_form::survival(0.0, motion, t));
    assert!(apart > 5.0 * ks::critical(n), "{apart}");
}
