//! Dead pixels have no events, so that tests of events do not see them.

use super::*;

fn with_dead() -> (Evidence, Hypothesis) {
    let evidence = empty();
    let dead = library(EffectId::DeadPixels);
    let truth = Hypothesis::baseline(&evidence).with(dead, &[0.25_f64.ln()]);
    (null_distribution::draw_recording(&evidence, &truth, 7), truth)
}

#[test]
fn their_share_is_asked_for_though_only_their_number_is_reported() {
    let (_, truth) = with_dead();
    let at = truth.offset_of(0);
    let shares = acceptance::with_strength_fixed_aside(&truth, 0)
        .unwrap()
        .map(|aside| aside.values[at].exp());
    assert!((shares[0] - 0.25 / 3.0).abs() < 1e-9 && shares[1] == 0.5, "{shares:?}");
    assert!(acceptance::parameter_at_bound(&truth, 0).is_none());
    let half = Hypothesis::baseline(&empty()).with(truth.effects[0], &[0.5_f64.ln()]);
    assert!(
        acceptance::parameter_at_bound(&half, 0)
            .is_some_and(|parameter| parameter.key == "fraction")
    );
}

#[test]
fn their_name_stands_on_a_light_that_is_late_and_another_does_not() {
    let (mut real, truth) = with_dead();
    for pixel in &mut real.pixels {
        pixel.light.rotate_right(10);
    }
    let little = two_sample_test::StructureTest::of(0.01);
    let plain = Hypothesis::baseline(&real);
    let baseline = gauss_newton::score_model(&real, plain.clone());
    let before = Some(&little);
    let judge = effect_review::EffectReview { before, ..judging(&real, &baseline) };
    let named = |hypothesis: Hypothesis| {
        let judged = judge.review(gauss_newton::score_model(&real, hypothesis), one_taken());
        assert!(judged.after.unwrap().nats > 0.05, "late events are found");
        judged.taken.len()
    };
    assert_eq!(named(truth), 1);
    assert_eq!(named(plain.with(library(EffectId::EventDrop), &[0.25])), 0);
}
