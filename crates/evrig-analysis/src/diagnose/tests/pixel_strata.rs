//! Recovery of pixels' own thresholds.

use super::*;

/// Thresholds with a spread of 0.11, each resolved within a twentieth of that.
fn planted_thresholds() -> (Evidence, Vec<PixelStratum>, Hypothesis) {
    planted(0.11, 0.013)
}

/// Thresholds with a spread `spread` and relative noise `noise`; with the true strata and a
/// fine-grid model without mismatch.
fn planted(spread: f64, noise: f64) -> (Evidence, Vec<PixelStratum>, Hypothesis) {
    let evidence = empty().thinned(4);
    let fine = Hypothesis { uses_fine_grid: true, ..Hypothesis::baseline(&evidence) };
    let sharp = fine.with_nuisance(Nuisance::LogNoise, noise.ln());
    let hidden = sharp.with(library(EffectId::ThresholdMismatch), &[spread.ln(), 0.0]);
    let mut random = SplitMix::new(5, 0);
    let kinds: Vec<PixelStratum> =
        evidence.pixels.iter().map(|_| [random.normal(), random.normal()]).collect();
    let of = |(pixel, stratum): (&PixelEvidence, &PixelStratum)| {
        let view = hidden.view(&evidence, pixel, *stratum, Vec::new());
        crate::predict::sample(&view.law, view.light(), END_US, &mut random)
    };
    let spikes = evidence.pixels.iter().zip(&kinds).map(of).collect();
    (evidence.with_events(spikes), kinds, sharp)
}

#[test]
fn thresholds_come_out_as_far_apart_as_they_are() {
    // The second camera is nearly noise-free, so that thresholds are resolved more finely.
    for (own, noise) in [(0.11, 0.013), (0.2, 0.002)] {
        let (planted, kinds, sharp) = planted(own, noise);
        let n = kinds.len() as f64;
        let mean = |of: fn(&PixelStratum) -> f64| kinds.iter().map(of).sum::<f64>() / n;
        let variance = mean(|[on, off]| 0.5 * (on * on + off * off));
        let (spread, correlation) = (own * variance.sqrt(), mean(|[on, off]| on * off) / variance);
        let nats = |by: f64, correlation: f64| {
            let there = [(spread * by).ln(), correlation];
            let there = sharp.with(library(EffectId::ThresholdMismatch), &there);
            gauss_newton::score_model(&planted, there).training() * planted.n_events() as f64
        };
        let best = nats(1.0, correlation);
        for (by, aside) in [(0.9, 0.0), (1.1, 0.0), (1.0, -0.3), (1.0, 0.3)] {
            let there = nats(by, correlation + aside);
            assert!(there < best - 1.0, "{own}, {noise}, {by}, {aside}: {there} for {best}");
        }
    }
}

#[test]
fn a_mismatch_must_hold_on_the_fine_grid() {
    let id = EffectId::ThresholdMismatch;
    let (spread, _, sharp) = planted_thresholds();
    let alike = null_distribution::draw_recording(&spread, &sharp, 3);
    for (evidence, is_there) in [(spread, true), (alike, false)] {
        let apart = sharp.with(library(id), &[0.11_f64.ln(), 0.0]);
        let coarse =
            gauss_newton::score_model(&evidence, Hypothesis { uses_fine_grid: false, ..apart });
        let model = gauss_newton::score_model(&evidence, sharp.clone());
        // Significant, and suggestive.
        for error in [0.02, 0.04] {
            let gain = effect_scan::EffectGain { id, training: 0.13, held_out: 0.13, error };
            let fitted = coarse.clone();
            let promising =
                effect_scan::TrialFit { gain, fitted, uses_all_pixels: true, has_converged: false };
            assert_eq!(search::holds_on_fine_grid(&evidence, &model, &promising), is_there);
        }
    }
}

#[test]
fn beside_a_held_hypothesis_scores_change_smoothly() {
    let (planted, _, sharp) = planted_thresholds();
    let own = gauss_newton::score_model(
        &planted,
        sharp.with(library(EffectId::ThresholdMismatch), &[0.11_f64.ln(), 0.0]),
    );
    let held = own.with_shared_grid(&planted);
    assert_eq!(held.clone().rescored(&planted).cells.log_likelihood, own.cells.log_likelihood);
    // Largest change of slope between successive steps along a value.
    let rough = |hypothesis: &Hypothesis| -> f64 {
        let bend = |i: usize| {
            let at = |k: i32| {
                let mut moved = hypothesis.clone();
                moved.values[i] += 0.1 * f64::from(k) * moved.steps[i];
                gauss_newton::score_model(&planted, moved).training() * planted.n_events() as f64
            };
            let along: Vec<f64> = (-4..=4).map(at).collect();
            along.windows(3).map(|at| (at[0] - 2.0 * at[1] + at[2]).abs()).fold(0.0, f64::max)
        };
        bend(Nuisance::LogTheta as usize).max(bend(hypothesis.offset_of(0)))
    };
    let (beside, own) = (rough(&held.hypothesis), rough(&own.hypothesis));
    assert!(beside < 0.2 * own, "{beside} beside a held one, {own} without");
}

#[test]
fn pixels_are_pinned_to_their_true_stratum_and_unpinned() {
    let (planted, kinds, sharp) = planted_thresholds();
    let model = sharp.with(library(EffectId::ThresholdMismatch), &[0.11_f64.ln(), 0.0]);
    let pinned = model.clone().pin_strata(&planted);
    let off = planted.pixels.iter().zip(&kinds).map(|(pixel, [on, _])| {
        let [pinned, _] = pinned.pinned_stratum(pixel).unwrap();
        (pinned - on).abs()
    });
    let mut off: Vec<f64> = off.collect();
    off.sort_by(f64::total_cmp);
    assert!(off[off.len() / 2] < 0.15, "{off:?}");
    // The spread of known thresholds is not fitted.
    let own = pinned.offset_of(0)..;
    assert_eq!(pinned.steps[own.clone()], [0.0; 2]);
    let again = pinned.unpin_strata(&model);
    assert_eq!(again.steps[own.clone()], model.steps[own]);
    let [again, model] =
        [again, model].map(|hypothesis| gauss_newton::score_model(&planted, hypothesis));
    assert_eq!(again.cells.log_likelihood, model.cells.log_likelihood);
}

#[test]
fn a_refractory_period_is_recovered_with_threshold_mismatch() {
    let (evidence, dead) = (empty().thinned(4), library(EffectId::RefractoryPeriod));
    let spread = Hypothesis::baseline(&evidence)
        .with(library(EffectId::ThresholdMismatch), &[0.15_f64.ln(), 0.0]);
    let hidden = spread.with(dead, &[4_000.0_f64.ln(), 0.0]);
    let planted = null_distribution::draw_recording(&evidence, &hidden, 17);
    let model = gauss_newton::fit(&planted, spread, 6, 1e-4);
    let begun = model.hypothesis.with(dead, &[1_500.0_f64.ln(), 0.0]);
    let fitted = gauss_newton::score_model(&planted, begun);
    let gain = effect_scan::EffectGain { id: dead.id, training: 0.0, held_out: 0.0, error: 0.0 };
    let begun = effect_scan::TrialFit { gain, fitted, uses_all_pixels: true, has_converged: false };
    let found = begun.converged(&planted, &model);
    // Fifteen pixels resolve it no better than a fit that starts at the truth.
    let there = gauss_newton::fit(&planted, hidden.clone(), 12, 1e-5);
    let [us, own] = [&found.fitted, &there].map(|fitted| fitted.hypothesis.parameters_of(1)[0]);
    assert!((us / own - 1.0).abs() < 0.05, "{us} for {own}");
    let [found_nats, own] = [&found.fitted, &there].map(|fitted| fitted.training());
    assert!(found_nats > own - 0.01, "{found_nats} for {own}");
    assert!(found.gain.held_out > 4.0 * found.gain.error, "{:?}", found.gain);
    // Strata are unknown again, and their spread is free.
    assert!(found.fitted.hypothesis.pixel_mixture().is_continuous());
    assert!(found.fitted.hypothesis.steps.iter().zip(&hidden.steps).all(|(a, b)| a == b));
}
