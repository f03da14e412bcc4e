//! A leak a little beyond what every camera has.

use super::*;

#[test]
fn an_all_but_ideal_camera_tells_a_leak_that_is_a_third_beyond_an_ordinary_one() {
    let evidence = empty();
    let sharp = Hypothesis::baseline(&evidence).with_nuisance(Nuisance::LogNoise, -6.0);
    let sharp = [Nuisance::LogBackgroundOn, Nuisance::LogBackgroundOff]
        .into_iter()
        .fold(sharp, |sharp, rate| sharp.with_nuisance(rate, -9.0));
    let leaking = sharp.with(library(EffectId::JunctionLeak), &[0.41]);
    let real = null::draw(&evidence, &leaking, 9);
    // The ordinary range ends at 0.3 Hz.
    let held = fit::as_it_is(&real, sharp.with_nuisance(Nuisance::LeakHz, 0.3));
    let leak = library(EffectId::JunctionLeak);
    let first = scan::first_step(&real, &real, &held, leak, std::iter::empty()).unwrap();
    let gain = first.training() - held.training();
    let hz = first.hypothesis.nuisance(Nuisance::LeakHz);
    // From 0.6 Hz, the least that is begun with elsewhere, one step does not come as near as this.
    assert!(gain > 0.0 && (0.3..0.5).contains(&hz), "{hz} Hz gains {gain} nats an event");
}
