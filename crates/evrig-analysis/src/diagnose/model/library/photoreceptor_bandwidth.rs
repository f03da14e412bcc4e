//! Photoreceptor bandwidth proportional to intensity.

use super::{CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, PredictedPixel};
use std::f64::consts::TAU;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::PhotoreceptorBandwidth,
    equation: "tau(L) y' = x - y, 1 / (2 pi tau) = f_white L / L_white (order times)",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008; \
             Graca and Delbruck, arXiv 2109.08640",
    stage: CandidateStage::Receptor,
    parameters: &[
        CandidateParameter::log("cutoff_hz_at_white", [0.5, 3_000.0]),
        CandidateParameter::fixed("order", [1.0, 2.0]),
        // Dark current keeps the cutoff above zero.
        CandidateParameter::log("floor", [1e-3, 0.3]).hidden(),
    ],
    starting_points: |_| {
        let start = |&(hz, order): &(f64, f64)| vec![f64::ln(hz), order, 0.02_f64.ln()];
        [(10.0, 1.0), (30.0, 1.0), (100.0, 1.0), (300.0, 1.0), (30.0, 2.0), (120.0, 2.0)]
            .iter()
            .map(start)
            .collect()
    },
    apply: |values, _, view| {
        let (white, order, floor) = (values[0], values[1], values[2]);
        let step_s = view.step_s();
        for _ in 0..(order.round() as usize).clamp(1, 2) {
            let hz = |level: f32| white * (f64::from(level.exp()) + floor) / (1.0 + floor);
            filter(view, |level| FirstOrderPole::new(hz(level), step_s));
        }
    },
    competing: &[
        EffectId::FixedPole,
        EffectId::ClockOffset,
        EffectId::Defocus,
        EffectId::RefractoryPeriod,
    ],
    separating_recording: "the same path in five times less light: this cutoff falls with the \
         light, the others do not",
    describe: |values| {
        format!(
            "the photoreceptor's bandwidth is {:.0} Hz at white, proportional to intensity",
            values[0]
        )
    },
    ..PLAIN
};

/// A first-order low-pass filter with a fixed time step.
#[derive(Clone, Copy)]
pub(super) struct FirstOrderPole {
    /// Time constant, instants.
    tau: f64,
    /// Decay factor per instant.
    kept: f64,
}

impl FirstOrderPole {
    pub(super) fn new(cutoff_hz: f64, step_s: f64) -> Self {
        let per_step = TAU * cutoff_hz.max(1e-3) * step_s;
        // The signal has single precision.
        Self { tau: per_step.recip(), kept: f64::from((-per_step as f32).exp()) }
    }
}

/// Low-pass filter with a cutoff that depends on log intensity; exact for a piecewise linear
/// signal.
pub(super) fn filter(view: &mut PredictedPixel<'_>, pole: impl Fn(f32) -> FirstOrderPole) {
    let level = &view.pixel.light;
    let mut state: Option<(f64, f64)> = None;
    for (signal, level) in view.signal.iter_mut().zip(level) {
        let x = f64::from(*signal);
        if !x.is_finite() {
            state = None;
            continue;
        }
        let y = match state {
            None => x,
            Some((y, before)) => {
                let FirstOrderPole { tau, kept } = pole(*level);
                let lag = (x - before) * tau;
                x - lag + (y - before + lag) * kept
            }
        };
        state = Some((y, x));
        *signal = y as f32;
    }
}
