//! Hypotheses about the reference level, and the signals at which none of them allows an event.

use super::law::{ComparatorLaw, LOGISTIC_SD};

/// Logistic scales below the threshold from which a hazard is neglected: 3e-4 events per crossing,
/// a thirtieth of the smallest mismatch that is named.
pub(super) const REACH: f64 = 8.0;

/// A hypothesis about the reference level.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ReferenceHypothesis {
    pub(super) weight: f64,
    pub(super) reference: f64,
    /// Variance of the reference level in squared logistic scales of log intensity.
    pub(super) variance: f64,
}

/// Levels around the reference level from which no crossing is possible.
pub(super) struct UnreachableBand {
    reference: f64,
    /// Thresholds less the reach of the reference level's error; negative where it is ambiguous.
    room: [f64; 2],
    /// Reach of the noise after a path of at most one threshold, and of any path.
    scales: [f64; 2],
    /// Reach of the error of the stamps per change of the signal between two instants.
    per_change: f64,
}

impl UnreachableBand {
    pub(super) fn of(
        law: &ComparatorLaw,
        states: &[ReferenceHypothesis],
        max_noise: f64,
        step_s: f64,
    ) -> Self {
        let mut active = states.iter().filter(|s| s.weight > 1e-12);
        let single = active.next().filter(|_| active.next().is_none());
        let shot = law.shot_rms / LOGISTIC_SD;
        let noise2 = law.noise * law.noise;
        let scales = [1.0, max_noise].map(|p| REACH * (noise2 * p + shot * shot).sqrt());
        let per_change = REACH * law.jitter_s / LOGISTIC_SD / step_s;
        match single.filter(|_| law.loss <= 0.0) {
            Some(state) => {
                let room = law.theta.map(|theta| theta - REACH * state.variance.sqrt());
                Self { reference: state.reference, room, scales, per_change }
            }
            None => Self { reference: 0.0, room: [f64::NEG_INFINITY; 2], scales, per_change },
        }
    }

    /// Whether a segment of `length` instants lies within.
    pub(super) fn contains(
        &self,
        [from, to]: [f64; 2],
        length: f64,
        path: f64,
        darkness: f64,
    ) -> bool {
        let reach = self.scales[usize::from(path > 1.0)] * darkness
            + self.per_change * (to - from).abs() / length;
        from.max(to) - self.reference < self.room[0] - reach
            && self.reference - from.min(to) < self.room[1] - reach
    }
}
