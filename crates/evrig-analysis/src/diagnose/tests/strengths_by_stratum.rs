//! Events simulated from the model have equal strength in every stratum.

use super::*;

#[test]
fn background_is_told_by_events_of_either_polarity() {
    let evidence = empty();
    let background = [1.5_f64.ln(), 1.5_f64.ln(), 1.0];
    let model =
        Hypothesis::baseline(&evidence).with(library(EffectId::BackgroundActivity), &background);
    let [real, drawn] =
        [3, 4].map(|seed| null_distribution::draw_recording(&evidence, &model, seed));
    let model = gauss_newton::score_model(&real, model);
    let all = strength_constancy::strengths_by_stratum(&real, &drawn, &model, 0);
    assert!(acceptance::most_inconstant_stratum(&all).is_none());
    let told: Vec<_> = all.iter().filter(|s| s.covariate == "polarity_on").collect();
    assert_eq!(told.len(), 2, "events of each polarity: {told:?}");
    for stratum in told {
        assert!(stratum.error < 0.3, "{stratum:?}");
    }
}
