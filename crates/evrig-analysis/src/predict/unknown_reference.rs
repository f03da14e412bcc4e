//! The reference level before a pixel's first event: anywhere between the two thresholds.

use super::leaky_signal::{LeakySignal, SignalRange};
use super::softplus::{logistic, softplus};

/// An unknown reference level.
#[derive(Debug, Clone, Copy)]
pub(super) struct UnknownReference {
    /// Value of the signal at the beginning of the interval.
    pub(super) begin: f64,
    /// Scale of the thresholds' scatter.
    noise: f64,
    /// Sum of both thresholds.
    sum: f64,
}

impl UnknownReference {
    pub(super) fn new(signal: &LeakySignal<'_>, position: f64) -> Self {
        let law = signal.law;
        let noise = law.noise(signal.level(position));
        // Signal noise brings the signal as near to either threshold.
        let noise = noise.max(law.shot(noise));
        Self { begin: signal.value(position), noise, sum: law.theta_on + law.theta_off }
    }

    /// Probability of no event until the signal's extremes are `span` apart.
    pub(super) fn survival(&self, span: f64) -> f64 {
        softplus((self.sum - span) / self.noise) / softplus(self.sum / self.noise)
    }

    /// The span at which the survival probability has fallen to `survival`.
    pub(super) fn span_at(&self, survival: f64) -> f64 {
        let softened = softplus(self.sum / self.noise) * survival;
        self.sum - self.noise * softened.exp_m1().max(1e-300).ln()
    }

    /// Hazard per unit of the signal at a new extreme; 0 elsewhere.
    pub(super) fn hazard(&self, on: bool, range: SignalRange, value: f64) -> f64 {
        let is_new = if on { value >= range.high } else { value <= range.low };
        let z = (self.sum - (range.high - range.low)) / self.noise;
        let hazard = logistic(z) / (self.noise * softplus(z).max(1e-300));
        if is_new { hazard } else { 0.0 }
    }
}
