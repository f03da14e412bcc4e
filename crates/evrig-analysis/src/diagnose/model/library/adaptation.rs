//! Slow adaptation.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, needs_span};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::Adaptation,
    equation: "y = x - a z, T z' = x - z",
    source: "Delbruck and Mead, Adaptive photoreceptor with wide dynamic range, ISCAS 1994",
    stage: Stage::Receptor,
    parameters: &[
        Parameter::log("time_constant_s", [0.05, 20.0]),
        Parameter::linear("fraction", [0.0, 0.98], 0.02),
    ],
    starts: |_| vec![vec![0.3_f64.ln(), 0.2], vec![1.5_f64.ln(), 0.3], vec![0.3_f64.ln(), 0.6]],
    act: |values, _, view| {
        let (keep, fraction) = ((-view.step_s() / values[0]).exp(), values[1]);
        let mut slow: Option<f64> = None;
        for signal in &mut view.signal {
            let x = f64::from(*signal);
            if !x.is_finite() {
                slow = None;
                continue;
            }
            let z = slow.map_or(x, |z| x + (z - x) * keep);
            slow = Some(z);
            *signal = (x - fraction * z) as f32;
        }
    },
    rivals: &[EffectId::JunctionLeak, EffectId::TemperatureDrift],
    splitter: "a slower pass: what is forgotten grows with the time it takes",
    needs: |evidence| needs_span(evidence, 1.0),
    says: |values| {
        format!("{:.0} % of a change is forgotten within {:.2} s", values[1] * 100.0, values[0])
    },
    ..PLAIN
};
