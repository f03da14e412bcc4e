//! A clock delay beyond the prior, absorbed by nuisances.

use super::*;

const LATE_US: f64 = 45_000.0;

#[test]
fn a_clock_delay_is_found_though_nuisances_absorbed_it() {
    let mut evidence = empty();
    evidence.facts.is_motion_compensated = true;
    let late = library(EffectId::ClockOffset);
    let truth = Hypothesis::baseline(&evidence).with(late, &[LATE_US]);
    let real = null_distribution::draw_recording(&evidence, &truth, 5);
    let best = gauss_newton::score_model(&real, truth.clone());
    // Nuisances of insensitive pixels.
    let blurred = [(Nuisance::LogTheta, 1.1_f64.ln()), (Nuisance::LogNoise, 1.1_f64.ln())];
    let model = blurred
        .into_iter()
        .fold(Hypothesis::baseline(&real), |model, (n, value)| model.with_nuisance(n, value));
    let model = gauss_newton::score_model(&real, model);
    let first = effect_scan::first_step(&real, &real, &model, late, std::iter::empty()).unwrap();
    let us = first.hypothesis.nuisance(Nuisance::OffsetUs);
    assert!((us - LATE_US).abs() < 1_000.0, "{us} us");
    // A joint step goes most of the way to the true threshold and noise.
    let [begun, found, all] = [&model, &first, &best].map(fitted::FittedModel::training);
    assert!(found - begun > 0.5 * (all - begun), "{begun} {found} {all}");
}

#[test]
fn prior_starts_are_used_with_interpolated_light_only() {
    let mut evidence = empty();
    let leak = library(EffectId::JunctionLeak);
    let model = Hypothesis::baseline(&evidence).with(leak, &[2.0]);
    let model = model.with_nuisance(Nuisance::LogNoiseHz, 5.0);
    let pole = library(EffectId::FixedPole);
    let along = multistart::starting_points_on(&evidence, &model, pole);
    evidence.facts.is_motion_compensated = true;
    let all = multistart::starting_points_on(&evidence, &model, pole);
    assert_eq!(all.len(), along.len() + 3 * (pole.starting_points)(&evidence).len());
    assert!(along.iter().all(|start| start.nuisance(Nuisance::LogNoiseHz) == 5.0));
    let (anew, ordinary) = (&all[along.len()..], Nuisance::LogNoiseHz.prior(&evidence.facts));
    for start in anew {
        assert_eq!(start.nuisance(Nuisance::LogNoiseHz), ordinary.start);
        assert_eq!(start.nuisance(Nuisance::LeakHz), 2.0, "what an effect has found stays");
    }
}

#[test]
fn sparse_frames_limit_the_clock_reference() {
    let mut evidence = empty();
    let errors = |evidence: &Evidence| {
        [EffectId::ClockOffset, EffectId::ClockSkew]
            .map(|id| (library(id).reference_error)(evidence))
    };
    assert_eq!(errors(&evidence), [0.0; 2], "the light is known at any time");
    evidence.facts.from_scene = false;
    let half_s = 0.5 * evidence.seconds();
    let [offset_us, skew_ppm] = errors(&evidence);
    assert!((offset_us - 577.35).abs() < 0.01, "even within 1 ms: {offset_us}");
    assert!((skew_ppm - 408.25 / half_s).abs() < 0.01, "{skew_ppm}");
    evidence.facts.frame_us = 1_000.0;
    assert_eq!(errors(&evidence), [0.0; 2], "frames are dense");
}
