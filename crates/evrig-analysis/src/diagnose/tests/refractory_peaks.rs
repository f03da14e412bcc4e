//! The refractory period is found before any fit.

use super::*;
use crate::diagnose::evidence::refractory_peaks::refractory_peaks_us;

/// Events of a nearly noise-free camera with a refractory period left of column 33.
fn drawn(dead_us: Option<f64>) -> Evidence {
    let evidence = empty();
    let mut model = Hypothesis::baseline(&evidence)
        .with_nuisance(Nuisance::LogNoise, -4.5)
        .with_nuisance(Nuisance::LogNoiseAtRest, 0.0);
    if let Some(us) = dead_us {
        let left = Rectangle { x_px: [0, 33], y_px: [0, 60] };
        model =
            model.with_effect_in(library(EffectId::RefractoryPeriod), &[us.ln(), 0.0], Some(left));
    }
    null_distribution::draw_recording(&evidence, &model, 5)
}

#[test]
fn refractory_peaks_are_found_to_a_percent() {
    for us in [5_300.0, 21_000.0] {
        let found = refractory_peaks_us(&drawn(Some(us)));
        assert!((found[0] / us - 1.0).abs() < 0.01, "{us} us: {found:?}");
    }
    assert_eq!(refractory_peaks_us(&drawn(None)), Vec::<f64>::new());
}
