//! Thresholds that differ from pixel to pixel.

use super::{Candidate, EffectId, PLAIN, Parameter, logs};

/// Nodes from one to the next, standard deviations. A pixel's events tell its thresholds within a
/// fraction of their spread, so that few nodes far apart would shrink the spread to lie among them.
const STEP: f64 = 0.5;

/// Nodes on either side of the middle.
const N_SIDE: i32 = 6;

/// A standard normal law at even steps.
fn nodes() -> Vec<(f64, f64)> {
    let at = |i: i32| f64::from(i) * STEP;
    let density = |i: i32| (-0.5 * at(i).powi(2)).exp();
    let sum: f64 = (-N_SIDE..=N_SIDE).map(density).sum();
    (-N_SIDE..=N_SIDE).map(|i| (density(i) / sum, at(i))).collect()
}

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ThresholdMismatch,
    equation: "theta_p = theta exp(s e_p), e_p normal, fixed for each pixel",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008 (2.1 % contrast)",
    parameters: &[Parameter::log("sigma_relative", [0.005, 1.0])],
    starts: |_| logs(&[0.05, 0.15]),
    mixture: Some(|_| nodes()),
    act: |values, kind, view| {
        let factor = (values[0] * kind).exp();
        view.law.theta_on *= factor;
        view.law.theta_off *= factor;
    },
    rivals: &[EffectId::HotPixels, EffectId::Vignetting, EffectId::ShotNoise],
    splitter: "the same path twice: a pixel's own threshold is the same in both",
    says: |values| format!("thresholds differ from pixel to pixel by {:.0} %", values[0] * 100.0),
    ..PLAIN
};
