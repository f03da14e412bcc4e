//! An unchanged signal is scored without a copy.

use super::*;

#[test]
fn an_unchanged_signal_scores_as_its_copy() {
    let real = plant(None, &[]);
    let plain = Hypothesis::baseline(&real);
    // A leak of zero copies the signal.
    let copied = plain.with(library(EffectId::PhotocurrentLeak), &[0.0]);
    let is_plain = |hypothesis: &Hypothesis| hypothesis.leaves_light_unchanged(&real.pixels[0]);
    assert!(is_plain(&plain) && !is_plain(&copied));
    assert!(!is_plain(&plain.with_nuisance(Nuisance::ShiftX, 0.1)));
    let scores = |evidence: &Evidence| {
        [&plain, &copied]
            .map(|h| gauss_newton::score_model(evidence, h.clone()).cells.log_likelihood)
    };
    let [own, of_copy] = scores(&real);
    assert_eq!(own, of_copy);
    // The bends were computed before: a signal of half the contrast bends elsewhere.
    let pale = |light: &mut [f32]| light.iter_mut().for_each(|level| *level *= 0.5);
    let [pale, of_copy] = scores(&real.with_light_of(&Changed(pale)));
    assert_eq!(pale, of_copy);
    assert_ne!(own, pale);
}
