//! Events drawn from a pixel's model, for tests and for null distributions.

use super::leaky_signal::{LeakySignal, SignalRange};
use super::likelihood::{EventTerm, LikelihoodPass, LikelihoodVisitor, SilentInterval};
use super::noise_crossing::NoiseCrossing;
use super::pixel_events::Spike;
use super::pixel_law::PixelLaw;
use super::pixel_signal::PixelSignal;
use super::reference_mixture::ReferenceMixture;
use super::reference_reset::{FiredEvent, reset};
use super::reference_state::ReferenceState;
use super::time_blocks::TimeBlocks;
use super::unknown_reference::UnknownReference;
use evrig_core::stats::SplitMix;

/// Bound on a pixel's event rate, so that extreme parameters end.
const MAX_RATE_HZ: f64 = 20_000.0;

/// Events of one pixel drawn from its model, where the signal is known between the window's start and
/// `end_us`. The same random sequence gives the same events.
#[must_use]
pub fn sample(
    law: &PixelLaw,
    signal: PixelSignal<'_>,
    end_us: i64,
    random: &mut SplitMix,
) -> Vec<Spike> {
    let mut spikes = Vec::new();
    for (run, [from, to]) in signal.known_intervals(end_us) {
        let max_events = (MAX_RATE_HZ * (to - from).max(0.0) * 1e-6) as usize + 1;
        let mut sampler = EventSampler::new(law, signal, run, to, &mut *random);
        let mut start = sampler.first(from);
        let mut recorded_from_us = from;
        for _ in 0..max_events {
            let Some(drawn) = sampler.next(&start) else { break };
            let t_us = drawn.spike.t_us as f64;
            if t_us >= recorded_from_us && !sampler.is_lost() {
                spikes.push(drawn.spike);
                recorded_from_us = t_us + law.filter_refractory_s * 1e6;
            }
            start = sampler.after(&start, drawn);
        }
    }
    spikes
}

/// An event and the signal at that time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpikeContext {
    /// The event.
    pub spike: Spike,
    /// Change of the signal since the event before towards the event's polarity, log intensity.
    pub change: f64,
    /// Slope of the signal towards the event's polarity, log intensity per second.
    pub slope_per_s: f64,
    /// Log intensity relative to white.
    pub level: f64,
}

/// The events that followed, and would have followed, an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextEventPair {
    /// Number of the event that both follow.
    pub before: usize,
    /// The recorded next event; none at the end of the known signal.
    pub real: Option<SpikeContext>,
    /// One drawn from the model with the same past.
    pub drawn: Option<SpikeContext>,
}

/// For each event, the recorded next event and one drawn from the model. Under the true parameters
/// both have the same distribution, given any covariate known without the pixel's later events.
#[must_use]
pub fn next_events(
    law: &PixelLaw,
    pixel_signal: PixelSignal<'_>,
    spikes: &[Spike],
    end_us: i64,
    random: &mut SplitMix,
) -> Vec<NextEventPair> {
    let mut all = Vec::new();
    let blocks = TimeBlocks::new(end_us, 1);
    for (run, [from, to]) in pixel_signal.known_intervals(end_us) {
        let first = spikes.partition_point(|spike| (spike.t_us as f64) < from);
        let last = spikes.partition_point(|spike| spike.t_us as f64 <= to);
        let signal = LeakySignal::new(law, pixel_signal, run);
        let mut sampler = EventSampler::new(law, pixel_signal, run, to, &mut *random);
        let mut pass = LikelihoodPass::new(signal, from, &blocks);
        for before in first..last {
            pass.advance_past(before, spikes[before], to, &mut NoVisitor);
            let (references, awake_us) = pass.references();
            let real = (before + 1 < last).then(|| spikes[before + 1]);
            let drawn = sampler.next_recorded(references, spikes[before], awake_us);
            // Both relative to the likeliest reference level, whichever was drawn from.
            let Some(likeliest) = references.states().first() else { continue };
            let context = |spike| context(&signal, likeliest, spike);
            let (real, drawn) = (real.map(context), drawn.map(context));
            all.push(NextEventPair { before, real, drawn });
        }
    }
    all
}

struct NoVisitor;

impl LikelihoodVisitor for NoVisitor {
    fn silence(&mut self, _: &SilentInterval) {}
    fn event(&mut self, _: &EventTerm) {}
}

fn context(signal: &LeakySignal<'_>, state: &ReferenceState, spike: Spike) -> SpikeContext {
    let position = signal.position(spike.t_us as f64);
    let slope = signal.slope(position);
    SpikeContext {
        spike,
        change: state.change(signal.value(position), spike.on),
        slope_per_s: if spike.on { slope } else { -slope },
        level: signal.level(position),
    }
}

struct EventSampler<'a> {
    signal: LeakySignal<'a>,
    /// End of the known signal, microseconds.
    to: f64,
    random: &'a mut SplitMix,
}

/// The beginning of a silence.
struct SilenceStart {
    /// None before the first event.
    state: Option<ReferenceState>,
    /// Next event by signal or noise.
    crossing: Option<Spike>,
    /// Next background event.
    background: Spike,
}

#[derive(Clone, Copy)]
struct DrawnEvent {
    spike: Spike,
    is_background: bool,
}

/// Where the signal causes the next event.
struct CrossingLimits {
    from_us: f64,
    reference: f64,
    /// Thresholds, ON and OFF.
    thresholds: [f64; 2],
    /// Limit of the span of both extremes, while the reference level is unknown.
    span: Option<f64>,
    noise: Option<NoiseCrossing>,
}

impl<'a> EventSampler<'a> {
    /// Noise can cause an event anywhere, so every sample is visited.
    fn new(
        law: &'a PixelLaw,
        signal: PixelSignal<'a>,
        run: [usize; 2],
        to: f64,
        random: &'a mut SplitMix,
    ) -> Self {
        let signal = LeakySignal::new(law, PixelSignal { knots: None, ..signal }, run);
        Self { signal, to, random }
    }

    /// The silence before the first event.
    fn first(&mut self, from_us: f64) -> SilenceStart {
        let unknown = UnknownReference::new(&self.signal, self.signal.position(from_us));
        let span = Some(unknown.span_at(self.random.uniform()));
        let thresholds = [f64::INFINITY; 2];
        let reference = unknown.begin;
        let limits = CrossingLimits { from_us, reference, thresholds, span, noise: None };
        let crossing = self.crossing(&limits);
        SilenceStart { state: None, crossing, background: self.background(from_us) }
    }

    /// The silence after an event at `t_us` that left the pixel in `state`.
    fn start(&mut self, state: ReferenceState, t_us: i64, awake_us: f64) -> SilenceStart {
        let mut draw = |side: usize| {
            let hazard = state.hazard_before(side) + self.random.exponential();
            state.thresholds[side].maximum_at(hazard)
        };
        let thresholds = [draw(0), draw(1)];
        let noise = NoiseCrossing::new(self.signal.law, state.noise);
        let (from_us, reference) = (awake_us, state.reference);
        let limits = CrossingLimits { from_us, reference, thresholds, span: None, noise };
        let crossing = self.crossing(&limits);
        let crossing = crossing.map(|spike| Spike { t_us: spike.t_us.max(t_us + 1), ..spike });
        SilenceStart { state: Some(state), crossing, background: self.background(t_us as f64) }
    }

    /// The silence after a drawn event.
    fn after(&mut self, before: &SilenceStart, drawn: DrawnEvent) -> SilenceStart {
        let Spike { t_us, on } = drawn.spike;
        let law = self.signal.law;
        let is_without_reset = drawn.is_background
            && law.background_reset < 1.0
            && self.random.uniform() >= law.background_reset;
        if is_without_reset {
            let background = self.background(t_us as f64);
            return SilenceStart { background, ..*before };
        }
        let value = self.signal.value(self.signal.position(t_us as f64));
        let change = before.state.map(|state| state.change(value, on));
        let background_share = f64::from(u8::from(drawn.is_background));
        let event = FiredEvent { t_us: t_us as f64, on, background_share };
        let state = reset(&self.signal, event, change, self.to);
        self.start(state, t_us, t_us as f64 + law.refractory_s * 1e6)
    }

    /// The next event that is not lost, after a recorded one.
    fn next_recorded(
        &mut self,
        references: &ReferenceMixture,
        after: Spike,
        awake_us: f64,
    ) -> Option<Spike> {
        let mut left = self.random.uniform();
        let (first, others) = references.states().split_first()?;
        let mut state = *first;
        for other in others {
            left -= state.weight;
            if left < 0.0 {
                break;
            }
            state = *other;
        }
        let mut start = self.start(state, after.t_us, awake_us);
        let mut drawn = self.next(&start)?;
        while self.is_lost() {
            start = self.after(&start, drawn);
            drawn = self.next(&start)?;
        }
        Some(drawn.spike)
    }

    fn is_lost(&mut self) -> bool {
        let share = self.signal.law.drop_fraction;
        share > 0.0 && self.random.uniform() < share
    }

    fn background(&mut self, from_us: f64) -> Spike {
        let law = self.signal.law;
        let [on, off] = [law.background_on_hz, law.background_off_hz];
        let wait_s = self.random.exponential() / (on + off).max(1e-12);
        let is_on = self.random.uniform() * (on + off) < on;
        let t_us = (from_us + wait_s * 1e6).min(9e15).ceil() as i64;
        // Stamps are whole microseconds and strictly ascend.
        Spike { t_us: t_us.max(from_us as i64 + 1), on: is_on }
    }

    /// The earlier of the next events; `None` when both come after the end of the signal.
    fn next(&self, start: &SilenceStart) -> Option<DrawnEvent> {
        let background = Some(start.background).filter(|spike| (spike.t_us as f64) < self.to);
        let drawn = |spike, is_background| DrawnEvent { spike, is_background };
        match (start.crossing, background) {
            (Some(a), Some(b)) if b.t_us < a.t_us => Some(drawn(b, true)),
            (Some(a), _) => Some(drawn(a, false)),
            (None, b) => b.map(|b| drawn(b, true)),
        }
    }

    /// The first event by signal or noise.
    fn crossing(&mut self, limits: &CrossingLimits) -> Option<Spike> {
        if limits.from_us >= self.to {
            return None;
        }
        let signal = self.signal;
        let (mut at, end) = (signal.position(limits.from_us), signal.position(self.to));
        let mut before = signal.value(at) - limits.reference;
        let mut range = SignalRange::at(before);
        range.add(0.0);
        let mut hazards_left = [self.random.exponential(), self.random.exponential()];
        for (next, value) in signal.samples(at, end).chain([(end, signal.value(end))]) {
            let after = value - limits.reference;
            let seconds = (next - at) * signal.step_s();
            let since_s = [at, next].map(|p| (signal.time_us(p) - limits.from_us) * 1e-6);
            let segment = [seconds, signal.law.recovery(since_s)];
            let first = limits.first_in([before, after], range, segment, &mut hazards_left);
            if let Some((share, on)) = first {
                let t_us = signal.time_us(at + share * (next - at));
                return Some(Spike { t_us: t_us.round() as i64, on });
            }
            range.add(after);
            (before, at) = (after, next);
        }
        None
    }
}

impl CrossingLimits {
    /// The first event on a linear segment: its position as a share of the segment, and its polarity.
    /// The segment takes some seconds, in which signal noise has recovered a share of its rate.
    fn first_in(
        &self,
        [before, after]: [f64; 2],
        range: SignalRange,
        [seconds, recovered]: [f64; 2],
        hazards_left: &mut [f64; 2],
    ) -> Option<(f64, bool)> {
        let mut first: Option<(f64, bool)> = None;
        let mut offer = |share: f64, on: bool| {
            if first.is_none_or(|(earliest, _)| share < earliest) {
                first = Some((share, on));
            }
        };
        let extremes = [range.high, -range.low];
        for (side, on) in [(0, true), (1, false)] {
            let sign = if on { 1.0 } else { -1.0 };
            let (a, b) = (sign * before, sign * after);
            let limit = self.span.map_or(self.thresholds[side], |sum| sum - extremes[1 - side]);
            if b >= limit && b > a && b > extremes[side] {
                offer(((limit - a) / (b - a)).clamp(0.0, 1.0), on);
            }
        }
        if let Some(noise) = self.noise.filter(|_| seconds > 0.0) {
            let slope = (after - before) / seconds;
            let middle = 0.5 * (before + after);
            for (left, (on, y)) in hazards_left.iter_mut().zip([(true, middle), (false, -middle)]) {
                let hazard = noise.hazard(y, slope, on, recovered) * seconds;
                if hazard > *left {
                    offer(*left / hazard, on);
                }
                *left -= hazard;
            }
        }
        first
    }
}
