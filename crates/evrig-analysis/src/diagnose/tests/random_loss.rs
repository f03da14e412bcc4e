//! A loss of events at random, and one that is none.

use super::*;

#[test]
fn a_loss_has_no_name_where_what_comes_alone_is_missing() {
    let plain = Hypothesis::baseline(&empty());
    let truth = plain.with(library(EffectId::EventDrop), &[0.25]);
    let real = null_distribution::draw(&empty(), &truth, 7);
    let baseline = gauss_newton::as_it_is(&real, plain);
    let judged = |is_filtered: bool| {
        let judge = effect_review::Judge { is_filtered, ..judging(&real, &baseline) };
        judge.judged(gauss_newton::as_it_is(&real, truth.clone()), one_taken())
    };
    assert_eq!(judged(false).taken.len(), 1);
    let beside_a_filter = judged(true);
    assert!(beside_a_filter.taken.is_empty());
    assert!(beside_a_filter.suspects[0].because.contains("no neighbour's event came before"));
}
