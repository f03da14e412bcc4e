//! One pass over a pixel's signal and events: hazards of the events, compensators of the silences.

use super::leaky_signal::{LeakySignal, SignalRange};
use super::noise_crossing::{NoiseCrossing, SegmentEnd};
use super::pixel_events::Spike;
use super::pixel_law::PixelLaw;
use super::pixel_signal::PixelSignal;
use super::reference_mixture::ReferenceMixture;
use super::reference_reset::FiredEvent;
use super::reference_state::SignalPoint;
use super::time_blocks::{BlockScore, TimeBlocks};

/// Floor of an event's hazard, Hz, which keeps every score finite.
const MIN_HAZARD_HZ: f64 = 1e-9;
/// Bound on the splits of the reference level at one sample.
const MAX_SPLITS: usize = 64;
/// Change of the signal, over its noise, up to which segments are joined.
const JOINED_CHANGE: f64 = 0.1;

/// The prediction of one event just before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EventTerm {
    /// Number among the pixel's events.
    pub index: usize,
    /// Its time block.
    pub block: usize,
    /// The event.
    pub spike: Spike,
    /// Logarithm of the hazard of its polarity, per second.
    pub log_hazard: f64,
    /// Share of background in that hazard, 0 to 1.
    pub background_share: f64,
    /// Compensator since the event before, both polarities and background; exponential with mean 1
    /// under the true parameters.
    pub compensator: f64,
    /// Change of the signal since the last reset towards the event's polarity, log intensity; `None`
    /// for a first event.
    pub change: Option<f64>,
    /// Slope of the signal towards the event's polarity, log intensity per second.
    pub slope_per_s: f64,
    /// Log intensity relative to white.
    pub level: f64,
}

/// An interval inside one time block without an event, except possibly at its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SilentInterval {
    /// Its time block.
    pub block: usize,
    /// Begin, microseconds since the start of the window.
    pub from_us: f64,
    /// End, microseconds since the start of the window.
    pub to_us: f64,
    /// Expected number of ON events given the past.
    pub on: f64,
    /// Expected number of OFF events given the past.
    pub off: f64,
}

/// Receives the terms of the likelihood in order of time.
pub trait LikelihoodVisitor {
    /// A silent interval.
    fn silence(&mut self, interval: &SilentInterval);
    /// An event, after the silent interval that ends with it.
    fn event(&mut self, term: &EventTerm);
}

/// Visits the likelihood terms of a pixel. Whatever lies outside the known signal or the window of
/// `blocks` is left out.
pub fn visit(
    law: &PixelLaw,
    signal: PixelSignal<'_>,
    spikes: &[Spike],
    blocks: &TimeBlocks,
    visitor: &mut impl LikelihoodVisitor,
) {
    for (run, [from, to]) in signal.known_intervals(blocks.length_us()) {
        LikelihoodPass::new(LeakySignal::new(law, signal, run), from, blocks)
            .run(spikes, to, visitor);
    }
}

struct ScoreSum<'a>(&'a mut [BlockScore]);

impl LikelihoodVisitor for ScoreSum<'_> {
    fn silence(&mut self, interval: &SilentInterval) {
        let [on, off] = &mut self.0[interval.block].on_off;
        *on -= interval.on;
        *off -= interval.off;
    }

    fn event(&mut self, term: &EventTerm) {
        let block = &mut self.0[term.block];
        block.on_off[usize::from(!term.spike.on)] += term.log_hazard;
        block.n_events += 1;
    }
}

/// Log-likelihood of one pixel in each time block.
#[must_use]
pub fn score_pixel(
    law: &PixelLaw,
    signal: PixelSignal<'_>,
    spikes: &[Spike],
    blocks: &TimeBlocks,
) -> Vec<BlockScore> {
    let mut scores = vec![BlockScore::default(); blocks.n()];
    visit(law, signal, spikes, blocks, &mut ScoreSum(&mut scores));
    scores
}

/// The state of a pixel on its way through one known interval of its signal.
pub(super) struct LikelihoodPass<'a> {
    signal: LeakySignal<'a>,
    blocks: &'a TimeBlocks,
    now_us: f64,
    /// Time of the last event.
    fired_us: f64,
    /// End of the refractory period.
    awake_us: f64,
    references: ReferenceMixture,
    /// Range of the signal since the refractory period.
    range: SignalRange,
    /// Compensator of the range when a silence was last reported, ON and OFF.
    reported: [f64; 2],
    /// Compensator before the last split that is not reported yet, ON and OFF.
    before_split: [f64; 2],
    /// Compensator since the last event.
    compensator: f64,
    /// Reused memory.
    segments: Vec<SignalSegment>,
}

/// A linear segment of the signal.
#[derive(Debug, Clone, Copy)]
struct SignalSegment {
    seconds: f64,
    /// Share of its rate that signal noise has recovered.
    recovered: f64,
    from: f64,
    to: f64,
}

impl SignalSegment {
    /// Appends the segments from a position and value through samples (position, value). Consecutive
    /// segments with little change are joined.
    fn append(
        signal: &LeakySignal<'_>,
        fired_us: f64,
        from: (f64, f64),
        samples: impl Iterator<Item = (f64, f64)>,
        segments: &mut Vec<Self>,
    ) {
        let joined_change = JOINED_CHANGE * signal.law.shot_at_white;
        let (mut at, mut before) = from;
        let mut open: Option<Self> = None;
        for (position, value) in samples {
            let since_s = [at, position].map(|p| (signal.time_us(p) - fired_us) * 1e-6);
            let seconds = (position - at) * signal.step_s();
            let recovered = signal.law.recovery(since_s);
            match &mut open {
                Some(last)
                    if last.recovered >= 1.0 && (value - last.from).abs() < joined_change =>
                {
                    last.seconds += seconds;
                    last.to = value;
                }
                _ => {
                    let next = Self { seconds, recovered, from: before, to: value };
                    segments.extend(open.replace(next));
                }
            }
            (at, before) = (position, value);
        }
        segments.extend(open);
    }
}

impl<'a> LikelihoodPass<'a> {
    pub(super) fn new(signal: LeakySignal<'a>, from_us: f64, blocks: &'a TimeBlocks) -> Self {
        let position = signal.position(from_us);
        Self {
            signal,
            blocks,
            now_us: from_us,
            fired_us: f64::NEG_INFINITY,
            awake_us: from_us,
            references: ReferenceMixture::unknown(&signal, position),
            range: SignalRange::at(signal.value(position)),
            reported: [0.0; 2],
            before_split: [0.0; 2],
            compensator: 0.0,
            segments: Vec::new(),
        }
    }

    fn run(mut self, spikes: &[Spike], to_us: f64, visitor: &mut impl LikelihoodVisitor) {
        let first = spikes.partition_point(|spike| (spike.t_us as f64) < self.now_us);
        for (index, &spike) in spikes.iter().enumerate().skip(first) {
            if spike.t_us as f64 > to_us {
                break;
            }
            self.advance_past(index, spike, to_us, visitor);
        }
        self.silence(to_us, visitor);
    }

    /// Visits the silence before an event and the event; `end_us` ends the known signal.
    pub(super) fn advance_past(
        &mut self,
        index: usize,
        spike: Spike,
        end_us: f64,
        visitor: &mut impl LikelihoodVisitor,
    ) {
        let t_us = spike.t_us as f64;
        self.silence(t_us, visitor);
        self.references.update_weights(self.range);
        let term = self.term(index, spike);
        visitor.event(&term);
        let event = FiredEvent { t_us, on: spike.on, background_share: term.background_share };
        self.references.fire(&self.signal, event, self.range, end_us);
        self.fired_us = t_us;
        self.awake_us = t_us + self.signal.law.dead_s() * 1e6;
        let awake = self.signal.position(self.awake_us.min(end_us));
        self.range = SignalRange::at(self.signal.value(awake));
        self.reported = [0.0; 2];
        self.before_split = [0.0; 2];
        self.compensator = 0.0;
    }

    /// The reference levels, and the end of the refractory period in microseconds.
    pub(super) fn references(&self) -> (&ReferenceMixture, f64) {
        (&self.references, self.awake_us)
    }

    /// Visits a silence up to `to_us`, an interval per time block.
    fn silence(&mut self, to_us: f64, visitor: &mut impl LikelihoodVisitor) {
        let mut block = self.blocks.of(self.now_us);
        while self.now_us < to_us {
            let end = self.blocks.end_us(block);
            let end = if block + 1 < self.blocks.n() { end.min(to_us) } else { to_us };
            if end > self.now_us {
                let interval = self.advance(end, block);
                self.compensator += interval.on + interval.off;
                visitor.silence(&interval);
            }
            block = (block + 1).min(self.blocks.n() - 1);
        }
    }

    fn advance(&mut self, to_us: f64, block: usize) -> SilentInterval {
        let from_us = self.now_us;
        let start = from_us.max(self.awake_us);
        if to_us > start {
            let [from, to] = [start, to_us].map(|us| self.signal.position(us));
            if self.signal.law.drop_fraction > 0.0 {
                self.follow_with_losses(from, to);
            } else {
                self.follow(from, to);
            }
        }
        self.now_us = to_us;
        let compensator = self.references.compensator(self.range);
        let seconds = (to_us - from_us) * 1e-6;
        let expected = |side: usize, on: bool| {
            let crossed = compensator[side] - self.reported[side];
            crossed + self.before_split[side] + self.signal.law.background_hz(on) * seconds
        };
        let (on, off) = (expected(0, true), expected(1, false));
        self.reported = compensator;
        self.before_split = [0.0; 2];
        SilentInterval { block, from_us, to_us, on, off }
    }

    /// As [`Self::follow`], with the reference level split where events may have been lost.
    fn follow_with_losses(&mut self, from: f64, to: f64) {
        let signal = self.signal;
        let (mut at, mut before) = (from, signal.value(from));
        for next in signal.samples(from, to).chain([(to, signal.value(to))]) {
            let mut range = SignalRange::at(before);
            range.add(next.1);
            self.follow_samples(range, (at, before), [next].into_iter());
            (at, before) = next;
            for _ in 0..MAX_SPLITS {
                if !self.references.is_split_due(self.range, before) {
                    break;
                }
                let compensator = self.references.compensator(self.range);
                for (side, compensator) in compensator.into_iter().enumerate() {
                    self.before_split[side] += compensator - self.reported[side];
                }
                self.reported = [0.0; 2];
                self.references.update_weights(self.range);
                self.references.split(&signal, self.range, at);
                self.range = SignalRange::at(before);
            }
        }
    }

    /// Follows the signal between two positions.
    fn follow(&mut self, from: f64, to: f64) {
        let signal = self.signal;
        let [begin, end] = [signal.value(from), signal.value(to)];
        let mut range = SignalRange::at(begin);
        range.add(end);
        for (_, value) in signal.samples(from, to) {
            range.add(value);
        }
        self.follow_samples(range, (from, begin), signal.samples(from, to).chain([(to, end)]));
    }

    /// Extends the range and integrates the noise crossings from a position and value through samples
    /// within `range`.
    fn follow_samples(
        &mut self,
        range: SignalRange,
        from: (f64, f64),
        samples: impl Iterator<Item = (f64, f64)> + Clone,
    ) {
        self.range.add(range.high);
        self.range.add(range.low);
        let (signal, fired_us) = (self.signal, self.fired_us);
        self.segments.clear();
        for state in self.references.states_mut() {
            let extremes = [range.high - state.reference, state.reference - range.low];
            let noise = NoiseCrossing::new(signal.law, state.noise);
            let Some(noise) = noise.filter(|noise| noise.is_within_reach(extremes)) else {
                continue;
            };
            if self.segments.is_empty() {
                SignalSegment::append(&signal, fired_us, from, samples.clone(), &mut self.segments);
            }
            let mut end = SegmentEnd::at(from.1 - state.reference);
            for segment in &self.segments {
                let change = segment.to - state.reference;
                let share = [segment.seconds, segment.recovered];
                end = noise.integrate(end, change, share, &mut state.noise_compensator);
            }
        }
    }

    fn term(&self, index: usize, spike: Spike) -> EventTerm {
        let t_us = spike.t_us as f64;
        let (signal, law) = (&self.signal, self.signal.law);
        let position = signal.position(t_us);
        let (value, slope) = (signal.value(position), signal.slope(position));
        let since_s = (t_us - self.fired_us) * 1e-6;
        let point = SignalPoint { value, slope, recovered: law.recovery([since_s; 2]) };
        let hazard = if t_us > self.awake_us {
            self.references.hazard(law, spike.on, self.range, point)
        } else {
            0.0
        };
        let background = law.background_hz(spike.on).max(MIN_HAZARD_HZ);
        EventTerm {
            index,
            block: self.blocks.of(t_us),
            spike,
            log_hazard: (hazard + background).ln(),
            background_share: background / (hazard + background),
            compensator: self.compensator,
            change: self.references.change(value, spike.on),
            slope_per_s: if spike.on { slope } else { -slope },
            level: signal.level(position),
        }
    }
}
