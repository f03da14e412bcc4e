//! Events that the pixel fired and that were lost before they were recorded.
//!
//! A lost event changes the reference level, so the pixel fires sooner where the signal turns back.
//! While the signal keeps moving past a threshold, "fired" and "not fired" share one state. The state
//! is split when one of the two is nearly certain, or when the signal has turned and they differ.

use super::leaky_signal::{LeakySignal, SignalRange};
use super::reference_state::{MIN_WEIGHT, ReferenceState, merge_into};

/// A state less likely than this is dropped even where several could be merged.
const NEGLIGIBLE_WEIGHT: f64 = MIN_WEIGHT * MIN_WEIGHT;
/// From this probability on, a lost event is taken as certain.
const CERTAIN_LOSS: f64 = 0.98;
/// Below this probability, a lost event is ignored.
const POSSIBLE_LOSS: f64 = 0.02;
/// Share of a threshold by which the signal must fall back to count as turned.
const MIN_TURN: f64 = 0.15;
/// Lost events widen the scatter of the reference level by at most this factor.
const MAX_WIDENING: f64 = 2.5;

/// Whether a state must be split now that the signal is at `value`.
pub(super) fn is_split_due(states: &[ReferenceState], range: SignalRange, value: f64) -> bool {
    states.iter().any(|state| {
        let extremes = state.extremes(range);
        (0..2).any(|side| {
            let threshold = state.thresholds[side];
            if !threshold.may_have_fired(extremes[side]) {
                return false;
            }
            let fired = threshold.lost_probability(state.begin[side], extremes[side]);
            let turn = extremes[side] - state.change(value, side == 0);
            fired >= CERTAIN_LOSS || fired >= POSSIBLE_LOSS && turn >= MIN_TURN * threshold.theta()
        })
    })
}

/// Splits weighted states into those that have not fired and those whose event was lost. From
/// `position` on, the signal range is counted anew.
pub(super) fn split(
    states: &[ReferenceState],
    signal: &LeakySignal<'_>,
    range: SignalRange,
    position: f64,
) -> Vec<ReferenceState> {
    let value = signal.value(position);
    let noise = signal.noise(position);
    let all = states.iter().flat_map(|state| {
        let extremes = state.extremes(range);
        let lost = [0, 1]
            .map(|side| state.thresholds[side].lost_probability(state.begin[side], extremes[side]));
        let silent = ReferenceState {
            weight: state.weight * (1.0 - lost[0]) * (1.0 - lost[1]),
            ..state.restarted_at(extremes)
        };
        let fired = [0, 1].map(|side| ReferenceState {
            weight: state.weight * lost[side] * (1.0 - lost[1 - side]),
            ..after_loss(signal, state, side, extremes[side], [value, noise])
        });
        [silent].into_iter().chain(fired)
    });
    let mut merged = Vec::new();
    for state in all.filter(|state| state.weight >= NEGLIGIBLE_WEIGHT) {
        merge_into(&mut merged, state);
    }
    merged
}

/// The state after a lost event on one side, given the extreme change there and the signal's present
/// value and noise.
fn after_loss(
    signal: &LeakySignal<'_>,
    state: &ReferenceState,
    side: usize,
    extreme: f64,
    [value, noise]: [f64; 2],
) -> ReferenceState {
    let theta = state.thresholds[side].theta();
    let reference = if side == 0 { state.reference + theta } else { state.reference - theta };
    let widened = state.noise.hypot(noise).min(MAX_WIDENING * noise);
    let mut fired = ReferenceState::new(signal, reference, widened);
    fired.extremes[side] = (extreme - theta).max(0.0);
    fired.extremes[1 - side] = fired.change(value, side != 0).max(0.0);
    fired
}
