//! One pass over a pixel's signal and events.
//!
//! The reference level is known up to noise after every event; where events are lost or do not
//! reset the pixel, a small set of hypotheses about it is filtered (a hidden Markov model).

use super::band::{ReferenceHypothesis, UnreachableBand};
use super::law::{ComparatorLaw, LOGISTIC_SD};
use super::pixel_events::Spike;
use super::signal::SampledSignal;
use super::time_blocks::TimeBlocks;

/// Reference levels reached by up to two lost events to either side, and that before an event
/// which did not reset the pixel.
const N_STATES: usize = 6;
const RESET: usize = 2;
const KEPT: usize = 5;

/// Floor of a hazard, Hz: keeps scores finite.
const MIN_HAZARD_HZ: f64 = 1e-9;

/// An event as the law predicts it from the pixel's past.
#[derive(Debug, Clone, Copy)]
pub(crate) struct HazardTerm {
    /// Number among the pixel's events.
    pub(crate) index: usize,
    /// Block of time.
    pub(crate) block: usize,
    /// The event.
    pub(crate) spike: Spike,
    /// Logarithm of the hazard, per second.
    pub(crate) log_hazard: f64,
    /// Compensator since the event before.
    pub(crate) compensator: f64,
    /// Change of the signal since the reference level towards the event's polarity, thresholds.
    pub(crate) change: f64,
    /// Slope towards the event's polarity, log intensity per second.
    pub(crate) slope_per_s: f64,
    /// Log intensity over white.
    pub(crate) level: f64,
    /// Share of the hazard that belongs to the background.
    pub(crate) background_share: f64,
}

/// Receives the terms of the likelihood.
pub(crate) trait TermVisitor {
    /// A silent interval's compensator in a block.
    fn silence(&mut self, block: usize, compensator: f64);
    /// An event.
    fn event(&mut self, term: &HazardTerm);
    /// Called after each event with the state of the pixel, to draw the next one.
    fn after(&mut self, _pass: &PixelPass<'_>, _index: usize) {}
}

/// The state of a pixel on its way through a run of its signal.
#[derive(Debug, Clone)]
pub(crate) struct PixelPass<'a> {
    pub(super) law: &'a ComparatorLaw,
    pub(super) signal: SampledSignal<'a>,
    /// Position, instants.
    pub(super) position: f64,
    /// Time of the last event, in instants.
    pub(super) fired: f64,
    pub(super) states: [ReferenceHypothesis; N_STATES],
    /// Path of the signal since the reference level, thresholds.
    pub(super) path: f64,
    /// Compensators of crossings since the event before: ON, OFF.
    pub(super) crossed: [f64; 2],
    /// Largest squared factor of the noise by the path.
    pub(super) max_noise: f64,
    /// First burst that is not over.
    pub(super) next_burst: usize,
}

/// Visits all terms of a pixel.
pub(crate) fn visit(
    law: &ComparatorLaw,
    signal: SampledSignal<'_>,
    spikes: &[Spike],
    blocks: &TimeBlocks,
    visitor: &mut impl TermVisitor,
) {
    for [first, last] in signal.runs() {
        let (from, to) = (first as f64, last as f64);
        let mut pass: Option<PixelPass<'_>> = None;
        let mut compensator = 0.0;
        for (index, spike) in spikes.iter().enumerate() {
            let at = signal.position(spike.t_us as f64);
            if at < from {
                continue;
            }
            if at >= to {
                break;
            }
            match &mut pass {
                None => pass = Some(PixelPass::starting(law, signal, at, to, spike.on)),
                Some(pass) => {
                    pass.advance(at, blocks, |block, c| {
                        compensator += c;
                        visitor.silence(block, c);
                    });
                    visitor.event(&pass.fire(index, *spike, compensator, blocks, to));
                    compensator = 0.0;
                }
            }
            if let Some(pass) = &pass {
                visitor.after(pass, index);
            }
        }
        if let Some(pass) = &mut pass {
            pass.advance(to, blocks, |block, c| visitor.silence(block, c));
        }
    }
}

impl<'a> PixelPass<'a> {
    fn starting(
        law: &'a ComparatorLaw,
        signal: SampledSignal<'a>,
        at: f64,
        end: f64,
        on: bool,
    ) -> Self {
        let mut pass = Self {
            law,
            signal,
            position: at,
            fired: at,
            states: [ReferenceHypothesis::default(); N_STATES],
            path: 0.0,
            crossed: [0.0; 2],
            max_noise: law.max_path_share2(),
            next_burst: 0,
        };
        pass.reset(at, end, pass.first_shift(on), pass.stored_variance());
        pass
    }

    pub(super) fn darkness(&self, position: f64) -> f64 {
        let i = (position.max(0.0) as usize).min(self.signal.darkness.len() - 1);
        self.signal.darkness[i]
    }

    /// Variance of the noise that an event at the present position stores, whatever caused it.
    fn stored_variance(&self) -> f64 {
        let darkness = self.darkness(self.position);
        let noise = self.law.noise * darkness;
        let shot = self.law.shot_rms.max(0.0) * darkness / LOGISTIC_SD;
        self.law.stored_share * noise * noise + shot * shot
    }

    pub(super) fn leaky(&self, position: f64) -> f64 {
        self.signal.at(position) + self.law.leak_per_s * position * self.signal.step_us * 1e-6
    }

    /// One state at the signal after an event, shifted.
    fn reset(&mut self, at: f64, end: f64, shift: f64, variance: f64) {
        let taken = at + self.law.retake * self.law.refractory_s * 1e6 / self.signal.step_us;
        let reference = self.leaky(taken.min(end)) + shift;
        self.states = [ReferenceHypothesis::default(); N_STATES];
        for (k, state) in self.states.iter_mut().enumerate().take(KEPT) {
            let lost = k as f64 - RESET as f64;
            let theta = if lost > 0.0 { self.law.theta[0] } else { self.law.theta[1] };
            *state =
                ReferenceHypothesis { weight: 0.0, reference: reference + lost * theta, variance };
        }
        self.states[RESET].weight = 1.0;
        self.fired = at;
        self.path = 0.0;
        self.crossed = [0.0; 2];
    }

    /// Moves to a position; reports compensators by block.
    fn advance(&mut self, to: f64, blocks: &TimeBlocks, mut report: impl FnMut(usize, f64)) {
        let us = |at: f64| self.signal.start_us + at * self.signal.step_us;
        let mut block = blocks.of(us(self.position));
        let end_of = |block: usize| {
            if block + 1 < blocks.n() {
                self.signal.position(blocks.end_us(block))
            } else {
                f64::INFINITY
            }
        };
        let (signal, mut end) = (self.signal, end_of(block));
        let mut sum = 0.0;
        self.walk(to, |_, middle, hazard| {
            if middle > end {
                report(block, sum);
                sum = 0.0;
                block = blocks.of(signal.start_us + middle * signal.step_us);
                end = if block + 1 < blocks.n() {
                    signal.position(blocks.end_us(block))
                } else {
                    f64::INFINITY
                };
            }
            sum += hazard.0;
            false
        });
        report(block, sum);
    }

    /// Walks segments; `step` receives the middle and the total, ON and OFF compensators of each
    /// and ends the walk by `true`.
    pub(super) fn walk(
        &mut self,
        to: f64,
        mut step: impl FnMut(&Self, f64, (f64, [f64; 2])) -> bool,
    ) {
        let law = self.law;
        let step_s = self.signal.step_us * 1e-6;
        let end = self.fired + law.refractory_s / step_s;
        let mut at = self.position;
        if law.refractory_s > 0.0 {
            // Nothing happens before the gate opens.
            at = at.max(end - 12.0 * law.onset_s / step_s).min(to);
        }
        let band = UnreachableBand::of(law, &self.states, self.max_noise, step_s);
        let per_theta = 2.0 / (law.theta[0] + law.theta[1]);
        let leak = law.leak_per_s * step_s;
        let background = (law.background_hz[0] + law.background_hz[1]) * step_s;
        let samples = self.signal.signal;
        let mut value = self.leaky(at);
        while at < to {
            let index = at as usize;
            let mut next = (index + 1) as f64;
            let after = if next <= to && !(at < end && end < next) {
                samples[index + 1] + leak * next
            } else {
                next = to.min(next);
                if at < end && end < next {
                    next = end;
                }
                self.leaky(next)
            };
            let length = next - at;
            if at >= end {
                self.path += (after - value).abs() * per_theta;
            }
            self.position = next;
            let is_far =
                band.contains([value, after], length, self.path, self.signal.darkness[index]);
            let bursts = self.burst_events(at, next);
            let total = if is_far && (at - end) * step_s >= 36.0 * law.onset_s {
                let sides =
                    [0, 1].map(|side| law.background_hz[side] * length * step_s + bursts[side]);
                (background * length + bursts[0] + bursts[1], sides)
            } else if length > 0.0 {
                let since = [(at - self.fired) * step_s, (next - self.fired) * step_s];
                let gate = self.gate(since[0], since[1]);
                self.follow(
                    [value, after],
                    length * step_s,
                    0.5 * (at + next),
                    since[1],
                    gate,
                    bursts,
                )
            } else {
                (0.0, [0.0; 2])
            };
            if step(self, 0.5 * (at + next), total) {
                return;
            }
            at = next;
            value = after;
        }
        self.position = to;
    }

    /// Updates the weights over a segment; returns the compensators: all, and by polarity.
    fn follow(
        &mut self,
        ends: [f64; 2],
        seconds: f64,
        middle: f64,
        since_s: f64,
        gate: f64,
        bursts: [f64; 2],
    ) -> (f64, [f64; 2]) {
        let law = self.law;
        let background =
            [0, 1].map(|side| (law.background_hz[side] * seconds + bursts[side]) * gate);
        let darkness = self.darkness(middle);
        if law.loss <= 0.0 && self.states[KEPT].weight <= 1e-12 {
            let state = self.states[RESET];
            let (hazard, _) = self.segment(&state, ends, seconds, darkness, None, since_s);
            let [on, off] = hazard.on_off.map(|h| h * gate);
            self.crossed[0] += on;
            self.crossed[1] += off;
            let all = on + off + background[0] + background[1];
            return (all, [on + background[0], off + background[1]]);
        }
        let mut noise2 = None;
        let mut moved = [0.0; N_STATES];
        let mut sides = [0.0; 2];
        let mut before = 0.0;
        for k in 0..N_STATES {
            let state = self.states[k];
            if state.weight <= 1e-12 {
                continue;
            }
            before += state.weight;
            let (hazard, computed) = self.segment(&state, ends, seconds, darkness, noise2, since_s);
            noise2 = computed;
            let [on, off] = hazard.on_off.map(|h| h * gate);
            sides[0] += state.weight * on * (1.0 - law.loss);
            sides[1] += state.weight * off * (1.0 - law.loss);
            let kept = (-(on + off)).exp();
            moved[k] += state.weight * kept;
            if law.loss > 0.0 && on + off > 0.0 {
                let lost = state.weight * (1.0 - kept) * law.loss / (on + off);
                let up = if k < KEPT - 1 { k + 1 } else { k };
                let down = if k == KEPT { k } else { k.saturating_sub(1) };
                moved[up] += lost * on;
                moved[down] += lost * off;
            }
        }
        let after: f64 = moved.iter().sum();
        for (state, weight) in self.states.iter_mut().zip(moved) {
            state.weight = weight / after.max(1e-300);
        }
        self.crossed[0] += sides[0];
        self.crossed[1] += sides[1];
        let crossed = -(after / before).max(1e-300).ln();
        (
            crossed + background[0] + background[1],
            [sides[0] + background[0], sides[1] + background[1]],
        )
    }

    /// The term of an event at the present position; then the pixel is reset.
    fn fire(
        &mut self,
        index: usize,
        spike: Spike,
        compensator: f64,
        blocks: &TimeBlocks,
        end: f64,
    ) -> HazardTerm {
        let law = self.law;
        let side = usize::from(!spike.on);
        let sign = if spike.on { 1.0 } else { -1.0 };
        let since_s = (self.position - self.fired) * self.signal.step_us * 1e-6;
        let gate = self.gate(since_s, since_s);
        let background = (law.background_hz[side] + self.burst_hz(side)) * gate;
        let (mut hazard, mut shift, mut variance, mut change) = (0.0, 0.0, 0.0, 0.0);
        let mut kept = ReferenceHypothesis::default();
        let own = self.stored_variance();
        let mut crossed_all = 0.0;
        for state in self.states.iter().filter(|state| state.weight > 1e-12) {
            let at = self.instant(state, spike.on);
            let crossing = state.weight * at.crossing * gate * (1.0 - law.loss);
            let shot = state.weight * at.shot * gate * (1.0 - law.loss);
            crossed_all += crossing + shot;
            hazard += crossing + shot + state.weight * background;
            // Influence of an outlier on the reference level is bounded.
            let innovation = 2.0 * (0.5 * (1.0 - at.change)).tanh();
            let stored = crossing * (innovation * at.gain + at.lead) + shot * innovation;
            shift += sign * law.theta[side] * stored;
            variance += (crossing + shot) * at.variance + state.weight * background * own;
            change += state.weight * at.change;
            if state.weight > kept.weight {
                kept = *state;
            }
        }
        let floor = hazard.max(MIN_HAZARD_HZ);
        let background_share = (1.0 - crossed_all / floor).clamp(0.0, 1.0);
        let term = HazardTerm {
            index,
            block: blocks.of(spike.t_us as f64),
            spike,
            log_hazard: (hazard + MIN_HAZARD_HZ).ln(),
            compensator,
            change,
            slope_per_s: sign * self.signal.slope_per_s(self.position),
            level: f64::from(
                self.signal.level[(self.position as usize).min(self.signal.level.len() - 1)],
            ),
            background_share,
        };
        self.reset(self.position, end, shift / floor, variance / floor);
        let unreset = background_share * (1.0 - law.background_reset);
        if unreset > 1e-3 {
            self.states[RESET].weight = 1.0 - unreset;
            self.states[KEPT] = ReferenceHypothesis { weight: unreset, ..kept };
        }
        term
    }
}
