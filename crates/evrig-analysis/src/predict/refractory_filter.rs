//! A refractory filter behind the pixel: it removes events within a fixed time after an event that it
//! passed, while the pixel keeps firing and resetting its reference level.

use super::leaky_signal::LeakySignal;
use super::reference_state::ReferenceState;

/// Unrecorded events beyond this number widen the reference level no further.
const MAX_WIDENING_EVENTS: u32 = 6;

#[derive(Debug, Clone, Copy)]
struct UnrecordedReference {
    reference: f64,
    extremes: [f64; 2],
}

impl UnrecordedReference {
    fn follow(&mut self, value: f64) {
        let change = value - self.reference;
        self.extremes = [self.extremes[0].max(change), self.extremes[1].max(-change)];
    }

    /// After an event of one side, with the signal at `value`.
    fn fired(self, side: usize, theta: [f64; 2], value: f64) -> Self {
        let step = if side == 0 { theta[0] } else { -theta[1] };
        let mut next = Self { reference: self.reference + step, extremes: [0.0; 2] };
        next.follow(value);
        next
    }
}

/// Adds to `states` the possible states at `to` of a pixel that was in `state` at `from`, with events
/// in between not recorded. The pixel fires at its median thresholds; by their scatter, the last of
/// these events may not have occurred yet, or one more may have.
pub(super) fn propagate(
    signal: &LeakySignal<'_>,
    state: &ReferenceState,
    [from, to]: [f64; 2],
    states: &mut Vec<ReferenceState>,
) {
    let theta = [signal.law.theta_on, signal.law.theta_off];
    let mut now = UnrecordedReference { reference: state.reference, extremes: state.extremes };
    let (mut before, mut n) = (None::<UnrecordedReference>, 0_u32);
    let end = signal.value(to);
    for value in signal.samples(from, to).map(|(_, value)| value).chain([end]) {
        if let Some(before) = &mut before {
            before.follow(value);
        }
        now.follow(value);
        while let Some(side) = (0..2).find(|&side| now.extremes[side] >= theta[side]) {
            before = Some(now);
            now = now.fired(side, theta, value);
            n += 1;
        }
    }
    let at = |found: UnrecordedReference, n: u32, weight: f64| {
        let noise = signal.noise(to) * f64::from(1 + n.min(MAX_WIDENING_EVENTS)).sqrt();
        ReferenceState {
            weight: state.weight * weight,
            ..ReferenceState::new(signal, found.reference, noise).restarted_at(found.extremes)
        }
    };
    let silent = |found: UnrecordedReference, n: u32| {
        let state = at(found, n, 1.0);
        (-state.hazard_before(0) - state.hazard_before(1)).exp()
    };
    let not_yet = before.map_or(0.0, |before| silent(before, n.saturating_sub(1)));
    let no_more = silent(now, n);
    states.push(at(now, n, (1.0 - not_yet) * no_more));
    states.extend(before.map(|before| at(before, n.saturating_sub(1), not_yet)));
    let side = usize::from(now.extremes[1] / theta[1] > now.extremes[0] / theta[0]);
    let more = now.fired(side, theta, end);
    states.push(at(more, n + 1, (1.0 - not_yet) * (1.0 - no_more)));
}
