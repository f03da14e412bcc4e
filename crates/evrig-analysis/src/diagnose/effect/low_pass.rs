//! A first-order low pass of the signal.

use crate::diagnose::Evidence;
use crate::diagnose::model::view::ModelledPixel;
use std::f64::consts::TAU;

/// Cutoff at white of a pole in proportion to intensity whose delay at some intensity is the bound
/// on the stated clock offset: a faster one cannot be distinguished from an ordinary
/// delay.
pub(super) fn fastest_hz(evidence: &Evidence, intensity: f64) -> f64 {
    1e6 / (TAU * evidence.facts.offset_bound_us * intensity)
}

/// A first-order low pass, exact for a piecewise linear signal.
#[derive(Clone, Copy)]
pub(crate) struct SignalPole {
    tau: f64,
    kept: f64,
}

impl SignalPole {
    pub(crate) fn new(cutoff_hz: f64, step_s: f64) -> Self {
        let per_step = TAU * cutoff_hz.max(1e-3) * step_s;
        Self { tau: per_step.recip(), kept: (-per_step).exp() }
    }
}

pub(crate) fn filter(view: &mut ModelledPixel<'_>, pole: impl Fn(f32) -> SignalPole) {
    let level = &view.pixel.light;
    let mut state: Option<(f64, f64)> = None;
    for (signal, level) in view.signal.iter_mut().zip(level) {
        let x = *signal;
        if !x.is_finite() {
            state = None;
            continue;
        }
        let y = match state {
            None => x,
            Some((y, before)) => {
                let SignalPole { tau, kept } = pole(*level);
                let lag = (x - before) * tau;
                x - lag + (y - before + lag) * kept
            }
        };
        state = Some((y, x));
        *signal = y;
    }
}
