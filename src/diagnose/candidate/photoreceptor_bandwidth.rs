//! Photoreceptor bandwidth that goes with intensity.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, View};
use std::f64::consts::TAU;

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::PhotoreceptorBandwidth,
    equation: "tau(L) y' = x - y, 1 / (2 pi tau) = f_white L / L_white (order times)",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008; Graca and Delbruck, arXiv 2109.08640",
    stage: Stage::Receptor,
    parameters: &[
        Parameter::log("cutoff_hz_at_white", [0.5, 3_000.0]),
        Parameter::fixed("order", [1.0, 2.0]),
        // In the dark the cutoff does not fall to nothing: dark current keeps a floor.
        Parameter::log("floor", [1e-3, 0.3]).hidden(),
    ],
    starts: |_| {
        let start = |&(hz, order): &(f64, f64)| vec![f64::ln(hz), order, 0.02_f64.ln()];
        [(10.0, 1.0), (30.0, 1.0), (100.0, 1.0), (300.0, 1.0), (30.0, 2.0), (120.0, 2.0)]
            .iter()
            .map(start)
            .collect()
    },
    act: |values, _, view| {
        let (white, order, floor) = (values[0], values[1], values[2]);
        for _ in 0..(order.round() as usize).clamp(1, 2) {
            filter(view, |intensity| white * (intensity + floor));
        }
    },
    rivals: &[
        EffectId::FixedPole,
        EffectId::ClockOffset,
        EffectId::Defocus,
        EffectId::RefractoryPeriod,
    ],
    splitter: "the same path in light five times weaker: this cutoff falls with the light, the others stay",
    says: |values| {
        format!(
            "the photoreceptor follows light only up to {:.0} Hz at white, and less in proportion in the dark",
            values[0]
        )
    },
    ..PLAIN
};

/// Passes the signal through a first-order low-pass whose cutoff, in hertz, depends on intensity
/// over white. Between instants the light is straight, which is met exactly.
pub(super) fn filter(view: &mut View<'_>, cutoff_hz: impl Fn(f64) -> f64) {
    let h = view.step_s();
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
                let tau = 1.0 / (TAU * cutoff_hz(f64::from(*level).exp()).max(1e-3));
                let lag = (x - before) / h * tau;
                x - lag + (y - before + lag) * (-h / tau).exp()
            }
        };
        state = Some((y, x));
        *signal = y as f32;
    }
}
