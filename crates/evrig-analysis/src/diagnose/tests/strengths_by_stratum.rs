//! Events simulated from the model have equal strength in every stratum.

use super::*;

#[test]
fn background_strength_uses_both_polarities() {
    let evidence = empty();
    let background = [1.5_f64.ln(), 1.5_f64.ln(), 1.0];
    let model =
        Hypothesis::baseline(&evidence).with(library(EffectId::BackgroundActivity), &background);
    let [real, drawn] =
        [3, 4].map(|seed| null_distribution::draw_recording(&evidence, &model, seed));
    let model = gauss_newton::score_model(&real, model);
    let all = strength_constancy::strengths_by_stratum(&real, &drawn, &model, 0);
    assert!(acceptance::most_inconstant_stratum(&all).is_none());
    let by_polarity: Vec<_> = all.iter().filter(|s| s.covariate == "polarity_on").collect();
    assert_eq!(by_polarity.len(), 2, "events of each polarity: {by_polarity:?}");
    for stratum in by_polarity {
        assert!(stratum.error < 0.3, "{stratum:?}");
    }
}
