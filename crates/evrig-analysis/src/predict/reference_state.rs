//! One possible reference level of a pixel, with what has happened since it was stored.

use super::leaky_signal::{LeakySignal, SignalRange};
use super::noise_crossing::NoiseCrossing;
use super::pixel_law::PixelLaw;
use super::threshold::Threshold;

/// A state less likely than this is dropped.
pub(super) const MIN_WEIGHT: f64 = 2e-3;
/// Reference levels that differ by less of a threshold are merged.
const MERGE_DISTANCE: f64 = 0.02;

/// The signal at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct SignalPoint {
    pub(super) value: f64,
    /// Log intensity per second.
    pub(super) slope: f64,
    /// Share of its rate that signal noise has recovered since the last event.
    pub(super) recovered: f64,
}

/// A reference level with a weight.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReferenceState {
    pub(super) weight: f64,
    /// Value of the signal with which the pixel compares.
    pub(super) reference: f64,
    /// Extreme changes without an event, ON and OFF, when the state began: the cumulative hazard up
    /// to there does not count.
    pub(super) begin: [f64; 2],
    /// Extreme changes before the signal range that is counted now.
    pub(super) extremes: [f64; 2],
    pub(super) thresholds: [Threshold; 2],
    pub(super) noise: f64,
    /// Compensator of noise crossings since the state began, ON and OFF.
    pub(super) noise_compensator: [f64; 2],
}

impl ReferenceState {
    /// With thresholds scattered by `noise`.
    pub(super) fn new(signal: &LeakySignal<'_>, reference: f64, noise: f64) -> Self {
        let law = signal.law;
        let threshold = |theta| Threshold::new(theta, noise, law.drop_fraction);
        Self {
            weight: 1.0,
            reference,
            begin: [0.0; 2],
            extremes: [0.0; 2],
            thresholds: [threshold(law.theta_on), threshold(law.theta_off)],
            noise,
            noise_compensator: [0.0; 2],
        }
    }

    /// Extreme changes without an event, ON and OFF.
    pub(super) fn extremes(&self, range: SignalRange) -> [f64; 2] {
        let [up, down] = self.extremes;
        [(range.high - self.reference).max(up), (self.reference - range.low).max(down)]
    }

    /// Change towards ON or OFF at a value of the signal.
    pub(super) fn change(&self, value: f64, on: bool) -> f64 {
        if on { value - self.reference } else { self.reference - value }
    }

    /// Cumulative hazard of a threshold when the state began.
    pub(super) fn hazard_before(&self, side: usize) -> f64 {
        self.thresholds[side].cumulative_hazard(self.begin[side])
    }

    /// The same reference level, with a state that begins at given extremes.
    pub(super) fn restarted_at(self, extremes: [f64; 2]) -> Self {
        Self { begin: extremes, extremes, noise_compensator: [0.0; 2], ..self }
    }

    /// Compensator since the state began, ON and OFF.
    pub(super) fn compensator(&self, range: SignalRange) -> [f64; 2] {
        let extremes = self.extremes(range);
        [0, 1].map(|side| {
            self.thresholds[side].compensator(self.begin[side], extremes[side])
                + self.noise_compensator[side]
        })
    }

    /// Hazard per second of events by signal and noise.
    pub(super) fn hazard(
        &self,
        law: &PixelLaw,
        on: bool,
        range: SignalRange,
        point: SignalPoint,
    ) -> f64 {
        let SignalPoint { value, slope, recovered } = point;
        let side = usize::from(!on);
        let (rise, extreme) = (if on { slope } else { -slope }, self.extremes(range)[side]);
        let is_new = rise > 0.0 && self.change(value, on) >= extreme;
        let threshold = self.thresholds[side];
        let signal = if is_new { threshold.hazard(self.begin[side], extreme) * rise } else { 0.0 };
        let noise = NoiseCrossing::new(law, self.noise);
        signal
            + noise.map_or(0.0, |noise| noise.hazard(self.change(value, on), slope, on, recovered))
    }
}

/// Adds a state, or merges it with one of nearly the same reference level; the likelier one's values
/// are kept.
pub(super) fn merge_into(states: &mut Vec<ReferenceState>, other: ReferenceState) {
    let distance = MERGE_DISTANCE * other.thresholds[0].theta();
    match states.iter_mut().find(|s| (s.reference - other.reference).abs() < distance) {
        None => states.push(other),
        Some(state) if state.weight >= other.weight => state.weight += other.weight,
        Some(state) => *state = ReferenceState { weight: state.weight + other.weight, ..other },
    }
}
