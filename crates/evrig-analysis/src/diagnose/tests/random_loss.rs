//! Random loss of events, and a filter that imitates it.

use super::*;

#[test]
fn a_random_loss_is_rejected_with_missing_isolated_events() {
    let plain = Hypothesis::baseline(&empty());
    let truth = plain.with(library(EffectId::EventDrop), &[0.25]);
    let real = null_distribution::draw_recording(&empty(), &truth, 7);
    let baseline = gauss_newton::score_model(&real, plain);
    let judged = |misses_isolated_events: bool| {
        let judge =
            effect_review::EffectReview { misses_isolated_events, ..judging(&real, &baseline) };
        judge.review(gauss_newton::score_model(&real, truth.clone()), one_taken())
    };
    assert_eq!(judged(false).taken.len(), 1);
    let beside_a_filter = judged(true);
    assert!(beside_a_filter.taken.is_empty());
    assert!(
        beside_a_filter.rejected_effects[0].because.contains("no neighbour's event came before")
    );
}
