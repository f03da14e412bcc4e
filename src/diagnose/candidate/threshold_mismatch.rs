//! Thresholds that differ from pixel to pixel.

use super::{Candidate, EffectId, PLAIN, Parameter, logs};

/// Nodes and weights of Gauss and Hermite's rule with seven points for a standard normal law
/// (numpy.polynomial.hermite_e.hermegauss(7), weights over their sum).
const NODES: [(f64, f64); 7] = [
    (0.000_548_268_855_972_22, -3.750_439_717_725_74),
    (0.030_757_123_967_586_5, -2.366_759_410_734_54),
    (0.240_123_178_605_013, -1.154_405_394_739_97),
    (0.457_142_857_142_857, 0.0),
    (0.240_123_178_605_013, 1.154_405_394_739_97),
    (0.030_757_123_967_586_5, 2.366_759_410_734_54),
    (0.000_548_268_855_972_22, 3.750_439_717_725_74),
];

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ThresholdMismatch,
    equation: "theta_p = theta exp(s e_p), e_p normal, fixed for each pixel",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008 (2.1 % contrast)",
    parameters: &[Parameter::log("sigma_relative", [0.005, 1.0])],
    starts: |_| logs(&[0.05, 0.15]),
    mixture: Some(|_| NODES.to_vec()),
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
