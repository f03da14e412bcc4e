//! A leak slightly above the prior bound.

use super::*;

/// A nearly noise-free camera, and a recording with a leak of 0.41 Hz.
fn leaking() -> (Hypothesis, Evidence) {
    let evidence = empty();
    let sharp = Hypothesis::baseline(&evidence).with_nuisance(Nuisance::LogNoise, -6.0);
    let sharp = [Nuisance::LogBackgroundOn, Nuisance::LogBackgroundOff]
        .into_iter()
        .fold(sharp, |sharp, rate| sharp.with_nuisance(rate, -9.0));
    let leaking = sharp.with(library(EffectId::JunctionLeak), &[0.41]);
    let real = null_distribution::draw_recording(&evidence, &leaking, 9);
    (sharp, real)
}

#[test]
fn a_leak_a_third_above_the_prior_bound_is_found() {
    let (sharp, real) = leaking();
    // The prior bound is 0.3 Hz.
    let held = gauss_newton::score_model(&real, sharp.with_nuisance(Nuisance::LeakHz, 0.3));
    let leak = library(EffectId::JunctionLeak);
    let first = effect_scan::first_step(&real, &real, &held, leak, std::iter::empty()).unwrap();
    let gain = first.training() - held.training();
    let hz = first.hypothesis.nuisance(Nuisance::LeakHz);
    // A start at 0.6 Hz, the smallest of the library, ends farther away after one step.
    assert!(gain > 0.0 && (0.3..0.5).contains(&hz), "{hz} Hz gains {gain} nats per event");
}

#[test]
fn single_steps_help_where_joint_steps_stall() {
    let (sharp, real) = leaking();
    let fitted =
        gauss_newton::fit(&real, sharp.with(library(EffectId::JunctionLeak), &[0.3]), 6, 1e-9);
    // Joint steps alone stop at 0.312 Hz, 0.07 nats per event lower.
    let hz = fitted.hypothesis.nuisance(Nuisance::LeakHz);
    assert!((0.37..0.45).contains(&hz), "{hz} Hz");
}

#[test]
fn a_photocurrent_leak_is_found_beside_a_reset_junction_leak() {
    let (sharp, _) = leaking();
    // Without a junction leak, which was at its bound.
    let back = sharp.with_nuisance(Nuisance::LeakHz, 0.0);
    let leak = library(EffectId::PhotocurrentLeak);
    let real = null_distribution::draw_recording(&empty(), &back.with(leak, &[0.6]), 9);
    let rate = bound_escape::scan_first_parameter(&real, &back.with(leak, &[0.4]))
        .hypothesis
        .parameters_of(0)[0];
    // Steps of an eighth alone end at 0.617 Hz.
    assert!((rate / 0.6 - 1.0).abs() < 0.008, "{rate} Hz");
}
