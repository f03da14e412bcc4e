//! Maximum, standard errors and split-half fits.

use super::*;
use fit::fitted::FittedModel;
use fit::gauss_newton::score_model;

/// A fit, with standard errors, of the model that generated the events.
fn fitted(evidence: &Evidence, truth: &Hypothesis, seed: u64) -> FittedModel {
    let drawn = null_distribution::draw_recording(evidence, truth, seed);
    standard_errors::with_standard_errors(&drawn, score_model(&drawn, truth.clone()))
}

#[test]
fn standard_errors_match_the_actual_errors() {
    let evidence = empty().thinned(2);
    let truth = Hypothesis::baseline(&evidence)
        .with(library(EffectId::RefractoryPeriod), &[3_000.0_f64.ln(), 0.0]);
    let asked = [
        Nuisance::LogTheta as usize,
        Nuisance::LogRatio as usize,
        Nuisance::OffsetUs as usize,
        truth.offset_of(0),
    ];
    let mut squares = [0.0; 4];
    let n = 6;
    for seed in 0..n {
        let model = fitted(&evidence, &truth, seed);
        for (square, &at) in squares.iter_mut().zip(&asked) {
            let off = model.hypothesis.values[at] - truth.values[at];
            *square += (off / model.error_of(at)).powi(2) / n as f64;
        }
    }
    // 99.8 % interval of a chi-squared variable with 24 degrees of freedom over 24.
    let mean = squares.iter().sum::<f64>() / 4.0;
    assert!((0.4..2.0).contains(&mean), "{squares:?}");
    for square in squares {
        assert!((0.1..4.0).contains(&square), "{squares:?}");
    }
}

#[test]
fn different_halves_have_different_fits() {
    let evidence = empty();
    let with = |ratio: f64| {
        let asymmetry = library(EffectId::ThresholdAsymmetry);
        Hypothesis::baseline(&evidence).with(asymmetry, &[ratio.ln()])
    };
    // Even and odd tiles have different ratios.
    let drawn =
        [1.1, 1.2].map(|ratio| null_distribution::draw_recording(&evidence, &with(ratio), 5));
    let spikes = evidence.pixels.iter().enumerate().map(|(i, pixel)| {
        let of = &drawn[pixel.tile % 2];
        of.pixels[i].spikes.clone()
    });
    let both = evidence.with_events(spikes.collect());
    let baseline = score_model(&both, Hypothesis::baseline(&both));
    let model = standard_errors::with_standard_errors(&both, score_model(&both, with(1.15)));
    let split_half = split_half::split_half_fits(&both, &baseline, &model);
    let said = |i: usize| split_half[i].parameters["threshold_asymmetry.on_off_ratio"];
    assert!((said(0) - 1.1).abs() < 0.015, "even tiles: {}", said(0));
    assert!((said(1) - 1.2).abs() < 0.015, "odd tiles: {}", said(1));
    for time in [said(2), said(3)] {
        assert!((time - 1.15).abs() < 0.02, "either half of the time: {time}");
    }
}

#[test]
fn an_interpolated_sinusoid_has_unit_amplitude() {
    let evidence = empty();
    let baseline = Hypothesis::baseline(&evidence);
    let view = baseline.view(&evidence, &evidence.pixels[0], [0.0; 2], Vec::new());
    // Ten samples per period; amplitude of the linear interpolation, finely summed.
    let hz = 0.1 / view.step_s();
    let at: Vec<f64> = view.swing(hz, 0.3).take(1001).collect();
    let middle = 0.5 * view.signal.len() as f64;
    let (fine, mut sum) = (50, 0.0);
    for (i, pair) in at.windows(2).enumerate() {
        for k in 0..fine {
            let part = (f64::from(k) + 0.5) / f64::from(fine);
            let turn = std::f64::consts::TAU * 0.1 * (i as f64 + part - middle) + 0.3;
            sum += (pair[0] + part * (pair[1] - pair[0])) * turn.sin();
        }
    }
    let height = 2.0 * sum / (1000.0 * f64::from(fine));
    assert!((height - 1.0).abs() < 2e-3, "{height}");
}
