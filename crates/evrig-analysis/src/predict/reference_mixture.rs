//! The reference level of a pixel: usually one, otherwise a mixture of a few weighted ones.

use super::leaky_signal::{LeakySignal, SignalRange};
use super::pixel_law::{MAX_REFERENCE_STATES, PixelLaw};
use super::reference_reset::{FiredEvent, reset, with_stored_noise};
use super::reference_state::{MIN_WEIGHT, ReferenceState, SignalPoint, merge_into};
use super::unknown_reference::UnknownReference;
use super::{event_loss, refractory_filter};

/// A state less likely than this to have caused an event is taken not to have.
const MIN_CAUSE_SHARE: f64 = 0.02;
/// Signal noise that may have caused an event, in standard deviations, with its probability.
const STORED_NOISE: [[f64; 2]; MAX_REFERENCE_STATES] =
    [[0.6, 0.22], [1.2, 0.33], [1.8, 0.28], [2.5, 0.17]];
/// The same for the share of events that the known states do not explain.
const UNEXPLAINED_NOISE: [[f64; 2]; 3] = [[0.8, 0.3], [1.5, 0.4], [2.2, 0.3]];
/// Prior probability that none of the states is right.
const UNEXPLAINED: f64 = 0.02;

/// Reference levels with weights that add up to 1, the likeliest first.
#[derive(Debug)]
pub(super) struct ReferenceMixture {
    states: Vec<ReferenceState>,
    /// Before the first event, when there are no states.
    unknown: Option<UnknownReference>,
    /// Reused memory.
    spare: Vec<ReferenceState>,
    max_states: usize,
}

impl ReferenceMixture {
    /// At a position before which nothing is known of the pixel.
    pub(super) fn unknown(signal: &LeakySignal<'_>, position: f64) -> Self {
        let unknown = Some(UnknownReference::new(signal, position));
        let max_states = signal.law.max_reference_states();
        Self { states: Vec::new(), unknown, spare: Vec::new(), max_states }
    }

    /// The states; none before the first event.
    pub(super) fn states(&self) -> &[ReferenceState] {
        &self.states
    }

    pub(super) fn states_mut(&mut self) -> &mut [ReferenceState] {
        &mut self.states
    }

    /// Multiplies the weights by the probabilities of the silence up to now. The compensator so far
    /// must not be asked for afterwards.
    pub(super) fn update_weights(&mut self, range: SignalRange) {
        if self.states.len() > 1 {
            for state in &mut self.states {
                let [on, off] = state.compensator(range);
                state.weight *= (-on - off).exp();
            }
            normalise(&mut self.states, self.max_states);
        }
    }

    /// Compensator of the signal, ON and OFF. That of a mixture is divided between the sides in
    /// proportion to their means over the states.
    pub(super) fn compensator(&self, range: SignalRange) -> [f64; 2] {
        if let Some(unknown) = &self.unknown {
            let [up, down] = [range.high - unknown.begin, unknown.begin - range.low];
            return divided(unknown.survival(up + down), [up, down]);
        }
        if let [only] = self.states.as_slice() {
            return only.compensator(range);
        }
        let (mut survival, mut sides) = (0.0, [0.0; 2]);
        for state in &self.states {
            let [on, off] = state.compensator(range);
            survival += state.weight * (-on - off).exp();
            sides = [sides[0] + state.weight * on, sides[1] + state.weight * off];
        }
        divided(survival, sides)
    }

    /// Hazard per second of events by signal and noise, with updated weights.
    pub(super) fn hazard(
        &self,
        law: &PixelLaw,
        on: bool,
        range: SignalRange,
        point: SignalPoint,
    ) -> f64 {
        if let Some(unknown) = &self.unknown {
            let rise = if on { point.slope } else { -point.slope };
            return unknown.hazard(on, range, point.value) * rise.max(0.0);
        }
        self.states.iter().map(|state| state.weight * state.hazard(law, on, range, point)).sum()
    }

    /// Change towards ON or OFF relative to the likeliest reference level.
    pub(super) fn change(&self, value: f64, on: bool) -> Option<f64> {
        self.states.first().map(|likeliest| likeliest.change(value, on))
    }

    /// Whether a lost event requires a split, see [`event_loss`].
    pub(super) fn is_split_due(&self, range: SignalRange, value: f64) -> bool {
        event_loss::is_split_due(&self.states, range, value)
    }

    /// Splits the states by lost events, with updated weights.
    pub(super) fn split(&mut self, signal: &LeakySignal<'_>, range: SignalRange, position: f64) {
        self.states = event_loss::split(&self.states, signal, range, position);
        normalise(&mut self.states, self.max_states);
    }

    /// Advances to the state at the end of the refractory period of an event, with updated weights;
    /// `end_us` ends the known signal.
    pub(super) fn fire(
        &mut self,
        signal: &LeakySignal<'_>,
        event: FiredEvent,
        range: SignalRange,
        end_us: f64,
    ) {
        let law = signal.law;
        let unchanged = event.background_share * (1.0 - law.background_reset);
        self.reset_into_spare(signal, event, range, end_us);
        self.unknown = None;
        let mut range = range;
        if unchanged < MIN_WEIGHT {
            self.states.clear();
        } else if law.drop_fraction > 0.0 {
            let at = signal.position(event.t_us);
            self.split(signal, range, at);
            range = SignalRange::at(signal.value(at));
        }
        for state in &mut self.states {
            *state = state.restarted_at(state.extremes(range));
            state.weight *= unchanged;
        }
        let weight = if self.states.is_empty() { 1.0 } else { 1.0 - unchanged };
        self.states.extend(
            self.spare.iter().map(|new| ReferenceState { weight: weight * new.weight, ..*new }),
        );
        let filter_us = law.filter_refractory_s * 1e6;
        if filter_us > 0.0 {
            let [at, to] = [event.t_us, (event.t_us + filter_us).min(end_us)]
                .map(|t_us| signal.position(t_us));
            self.spare.clear();
            for state in &self.states {
                refractory_filter::propagate(signal, state, [at, to], &mut self.spare);
            }
            std::mem::swap(&mut self.states, &mut self.spare);
        }
        normalise(&mut self.states, self.max_states);
    }

    /// Puts into `spare` the states after a reset. Where noise is stored with the signal they depend
    /// on the states before.
    fn reset_into_spare(
        &mut self,
        signal: &LeakySignal<'_>,
        event: FiredEvent,
        range: SignalRange,
        end_us: f64,
    ) {
        let law = signal.law;
        let at = signal.position(event.t_us);
        let (value, slope) = (signal.value(at), signal.slope(at));
        let point = SignalPoint { value, slope, recovered: 1.0 };
        let reset = |state: Option<&ReferenceState>| {
            reset(signal, event, state.map(|state| state.change(value, event.on)), end_us)
        };
        self.spare.clear();
        let has_signal_noise = law.shot_at_white > 0.0;
        if has_signal_noise {
            let unexplained = event.background_share.max(UNEXPLAINED);
            let (share, noise): (f64, &[[f64; 2]]) = if self.states.is_empty() {
                (1.0, &STORED_NOISE)
            } else {
                (unexplained, &UNEXPLAINED_NOISE)
            };
            let plain = ReferenceState { weight: share, ..reset(None) };
            self.spare.extend(with_stored_noise(law, event, plain, noise));
            self.states.iter_mut().for_each(|state| state.weight *= 1.0 - share);
        } else if self.states.len() < 2 || law.noise_carry <= 0.0 {
            self.spare.push(reset(self.states.first()));
            return;
        }
        let mut shares = [0.0; MAX_REFERENCE_STATES];
        for (share, state) in shares.iter_mut().zip(&self.states) {
            *share = state.weight * state.hazard(law, event.on, range, point);
        }
        let all: f64 = shares.iter().sum();
        let explained: f64 = self.states.iter().map(|state| state.weight).sum();
        let min_weight = if has_signal_noise { MIN_WEIGHT } else { MIN_CAUSE_SHARE };
        for (state, share) in self.states.iter().zip(shares) {
            let weight = explained * if all > 0.0 { share / all } else { state.weight };
            if weight >= min_weight {
                merge_into(&mut self.spare, ReferenceState { weight, ..reset(Some(state)) });
            }
        }
    }
}

/// Keeps the likeliest states, likeliest first, with weights that add up to 1.
fn normalise(states: &mut Vec<ReferenceState>, max_states: usize) {
    if let [only] = states.as_mut_slice() {
        only.weight = 1.0;
        return;
    }
    states.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let all: f64 = states.iter().map(|state| state.weight).sum();
    let min = MIN_WEIGHT * all;
    let kept = states.iter().take(max_states).take_while(|state| state.weight >= min).count();
    states.truncate(kept.max(1));
    let sum: f64 = states.iter().map(|state| state.weight).sum();
    let n = states.len() as f64;
    for state in states {
        state.weight = if sum > 0.0 { state.weight / sum } else { 1.0 / n };
    }
}

/// The compensator of a survival probability, divided in proportion to `sides`.
fn divided(survival: f64, sides: [f64; 2]) -> [f64; 2] {
    let all = -survival.max(1e-300).ln();
    let sum = sides[0] + sides[1];
    let share = if sum > 0.0 { sides[0] / sum } else { 0.5 };
    [all * share, all * (1.0 - share)]
}
