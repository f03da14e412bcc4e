//! Slow adaptation.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, needs_span};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::Adaptation,
    equation: "y = x - a z, T z' = x - z",
    source: "Delbruck and Mead, Adaptive photoreceptor with wide dynamic range, ISCAS 1994",
    stage: CandidateStage::Receptor,
    parameters: &[
        CandidateParameter::log("time_constant_s", [0.05, 20.0]),
        CandidateParameter::linear("fraction", [0.0, 0.98], 0.02),
    ],
    starting_points: |_| {
        vec![vec![0.3_f64.ln(), 0.2], vec![1.5_f64.ln(), 0.3], vec![0.3_f64.ln(), 0.6]]
    },
    apply: |values, _, view| {
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
    competing: &[EffectId::JunctionLeak, EffectId::TemperatureDrift],
    separating_recording: "a slower pass: adaptation grows with its duration",
    requires: |evidence| needs_span(evidence, 1.0),
    describe: |values| {
        format!(
            "the photoreceptor adapts to {:.0} % of a change within {:.2} s",
            values[1] * 100.0,
            values[0]
        )
    },
    ..PLAIN
};
