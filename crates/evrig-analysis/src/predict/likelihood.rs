//! One pass over a pixel's light and events: every event's hazard, every silence's compensator.

use super::course::{Course, Reach};
use super::memory::{Case, Fired, Here, Memory, Unknown};
use super::movement::Corner;
use super::{Blocks, Light, PixelLaw, Spike};

/// The least hazard an event is given, a second: with it a score is a number whatever happened.
const LEAST_HAZARD: f64 = 1e-9;

/// At one instant memory is parted so often at most.
const MOST_PARTED: usize = 64;

/// What the pixel's law says of one event, just before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EventTerm {
    /// Number among the pixel's events.
    pub index: usize,
    /// Block of time it lies in.
    pub block: usize,
    /// The event.
    pub spike: Spike,
    /// Logarithm of the hazard of its polarity, a second.
    pub log_hazard: f64,
    /// The part of that hazard which is background, 0 to 1.
    pub background_share: f64,
    /// What the silence before it has spent of the compensator, both polarities and background;
    /// exponential of mean one where the law is true.
    pub spent: f64,
    /// Change of the signal since it was memorised, in the event's own direction, log intensity;
    /// `None` for a first event, before which the memory is not known.
    pub change: Option<f64>,
    /// Rate of change of the signal in the event's own direction, log intensity a second.
    pub slope_per_s: f64,
    /// Log intensity over white at the event.
    pub level: f64,
}

/// A stretch of time in one block without an event, but perhaps one at its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Block of time.
    pub block: usize,
    /// From, to: microseconds since the start of the window.
    pub from_us: f64,
    /// End, microseconds since the start of the window.
    pub to_us: f64,
    /// Expected number of On events given the past.
    pub on: f64,
    /// Expected number of Off events given the past.
    pub off: f64,
}

/// Sees what [`walk`] comes by, in the order of time.
pub trait Witness {
    /// A stretch of silence has passed.
    fn silence(&mut self, stretch: &Stretch);
    /// An event, behind the silence that ends with it.
    fn event(&mut self, term: &EventTerm);
}

/// Goes once over a pixel's events under a law. What lies outside the known light or the window
/// that `blocks` cuts is left out.
pub fn walk(
    law: &PixelLaw,
    light: Light<'_>,
    spikes: &[Spike],
    blocks: &Blocks,
    witness: &mut impl Witness,
) {
    for (run, [from, to]) in light.stretches(blocks.length_us()) {
        Pass::new(Course::new(law, light, run), from, blocks).run(spikes, to, witness);
    }
}

/// The state of a pixel on its way through one known stretch of its light.
pub(super) struct Pass<'a> {
    course: Course<'a>,
    blocks: &'a Blocks,
    /// Up to here, microseconds, the pass has come.
    now_us: f64,
    /// The last event.
    fired_us: f64,
    /// The pixel is heard from here on; later than now while it is blind.
    awake_us: f64,
    memory: Memory,
    /// How far the signal has gone since it was heard again.
    reach: Reach,
    /// What that had spent when silence was last reported.
    reported: [f64; 2],
    /// Spent before memory was parted and not reported yet, On and Off.
    parted: [f64; 2],
    /// All that was spent since the last event.
    spent: f64,
    /// For the passages that are followed now.
    steps: Vec<Step>,
}

/// Passages are one within which the signal changes by less than this share of its own noise.
const ALIKE: f64 = 0.1;

/// A straight passage of the signal.
#[derive(Debug, Clone, Copy)]
struct Step {
    seconds: f64,
    /// How much of what it can the signal's own noise does meanwhile.
    share: f64,
    /// Where the signal comes from and to.
    from: f64,
    height: f64,
}

impl Step {
    /// Into `steps`, passages one behind the other, from a position and a height on to others.
    fn all(
        course: &Course<'_>,
        fired_us: f64,
        from: (f64, f64),
        passages: impl Iterator<Item = (f64, f64)>,
        steps: &mut Vec<Self>,
    ) {
        let law = course.law;
        let alike = ALIKE * law.shot_at_white;
        let (mut at, mut before) = from;
        let mut open: Option<Self> = None;
        for (position, height) in passages {
            let behind = [at, position].map(|p| (course.time_us(p) - fired_us) * 1e-6);
            let seconds = (position - at) * course.step_s();
            let share = law.rested(behind);
            match &mut open {
                Some(last) if last.share >= 1.0 && (height - last.from).abs() < alike => {
                    last.seconds += seconds;
                    last.height = height;
                }
                _ => steps.extend(open.replace(Self { seconds, share, from: before, height })),
            }
            (at, before) = (position, height);
        }
        steps.extend(open);
    }
}

impl<'a> Pass<'a> {
    pub(super) fn new(course: Course<'a>, from_us: f64, blocks: &'a Blocks) -> Self {
        let position = course.position(from_us);
        Self {
            course,
            blocks,
            now_us: from_us,
            fired_us: f64::NEG_INFINITY,
            awake_us: from_us,
            memory: Memory::unknown(&course, Unknown::new(&course, position)),
            reach: Reach::at(course.height(position)),
            reported: [0.0; 2],
            parted: [0.0; 2],
            spent: 0.0,
            steps: Vec::new(),
        }
    }

    fn run(mut self, spikes: &[Spike], to_us: f64, witness: &mut impl Witness) {
        let first = spikes.partition_point(|spike| (spike.t_us as f64) < self.now_us);
        for (index, &spike) in spikes.iter().enumerate().skip(first) {
            if spike.t_us as f64 > to_us {
                break;
            }
            self.take(index, spike, to_us, witness);
        }
        self.silence(to_us, witness);
    }

    /// Passes the silence before an event and the event.
    pub(super) fn take(
        &mut self,
        index: usize,
        spike: Spike,
        to_us: f64,
        witness: &mut impl Witness,
    ) {
        self.silence(spike.t_us as f64, witness);
        self.memory.weigh(self.reach);
        let term = self.term(index, spike);
        witness.event(&term);
        self.memorise(&term, to_us);
    }

    /// What the pixel compares with, and from when on it is heard, microseconds.
    pub(super) fn memory(&self) -> (&Memory, f64) {
        (&self.memory, self.awake_us)
    }

    /// The pixel has fired; `end_us` ends the known light.
    fn memorise(&mut self, term: &EventTerm, end_us: f64) {
        let t_us = term.spike.t_us as f64;
        let (on, background_share) = (term.spike.on, term.background_share);
        let fired = Fired { t_us, on, background_share };
        self.memory.fire(&self.course, fired, self.reach, end_us);
        self.fired_us = t_us;
        self.awake_us = t_us + self.course.law.deaf_s() * 1e6;
        let awake = self.course.position(self.awake_us.min(end_us));
        self.reach = Reach::at(self.course.height(awake));
        self.reported = [0.0; 2];
        self.parted = [0.0; 2];
        self.spent = 0.0;
    }

    /// Passes a silence up to `to_us` and reports it, a stretch for each block of time.
    fn silence(&mut self, to_us: f64, witness: &mut impl Witness) {
        let mut block = self.blocks.of(self.now_us);
        while self.now_us < to_us {
            let end = self.blocks.end_us(block);
            let end = if block + 1 < self.blocks.n() { end.min(to_us) } else { to_us };
            if end > self.now_us {
                let stretch = self.advance(end, block);
                self.spent += stretch.on + stretch.off;
                witness.silence(&stretch);
            }
            block = (block + 1).min(self.blocks.n() - 1);
        }
    }

    fn advance(&mut self, to_us: f64, block: usize) -> Stretch {
        let from_us = self.now_us;
        let start = from_us.max(self.awake_us);
        if to_us > start {
            let [from, to] = [start, to_us].map(|us| self.course.position(us));
            if self.course.law.drop_fraction > 0.0 {
                self.follow_what_is_lost(from, to);
            } else {
                self.follow(from, to);
            }
        }
        self.now_us = to_us;
        let now_spent = self.memory.spent(self.reach);
        let seconds = (to_us - from_us) * 1e-6;
        let part = |side: usize, on: bool| {
            let crossed = now_spent[side] - self.reported[side];
            crossed + self.parted[side] + self.course.law.background_hz(on) * seconds
        };
        let (on, off) = (part(0, true), part(1, false));
        self.reported = now_spent;
        self.parted = [0.0; 2];
        Stretch { block, from_us, to_us, on, off }
    }

    /// The same as [`Self::follow`] where events may have been lost on the way.
    fn follow_what_is_lost(&mut self, from: f64, to: f64) {
        let course = self.course;
        let (mut at, mut before) = (from, course.height(from));
        for next in course.instants(from, to).chain([(to, course.height(to))]) {
            let mut here = Reach::at(before);
            here.add(next.1);
            self.pass(here, (at, before), [next].into_iter());
            (at, before) = next;
            for _ in 0..MOST_PARTED {
                if !self.memory.is_to_part(self.reach, before) {
                    break;
                }
                let spent = self.memory.spent(self.reach);
                for (side, spent) in spent.into_iter().enumerate() {
                    self.parted[side] += spent - self.reported[side];
                }
                self.reported = [0.0; 2];
                self.memory.weigh(self.reach);
                self.memory.part(&course, self.reach, at);
                self.reach = Reach::at(before);
            }
        }
    }

    /// Follows the signal between two positions: its extremes, and what the noise's own movement
    /// spends on the way.
    fn follow(&mut self, from: f64, to: f64) {
        let course = self.course;
        let [begin, end] = [course.height(from), course.height(to)];
        let mut here = Reach::at(begin);
        here.add(end);
        for (_, height) in course.instants(from, to) {
            here.add(height);
        }
        self.pass(here, (from, begin), course.instants(from, to).chain([(to, end)]));
    }

    /// Passes on from one position and height to others, straight in between, that reach so far.
    fn pass(
        &mut self,
        here: Reach,
        from: (f64, f64),
        passages: impl Iterator<Item = (f64, f64)> + Clone,
    ) {
        self.reach.add(here.high);
        self.reach.add(here.low);
        let (course, fired_us) = (self.course, self.fired_us);
        let is_near = |case: &Case| {
            let furthest = [here.high - case.value, case.value - here.low];
            let movement = case.movement(&course);
            movement.filter(|moves| moves.is_within_reach(furthest))
        };
        self.steps.clear();
        for case in self.memory.cases_mut() {
            let Some(movement) = is_near(case) else { continue };
            if self.steps.is_empty() {
                Step::all(&course, fired_us, from, passages.clone(), &mut self.steps);
            }
            let mut corner = Corner::at(from.1 - case.value);
            for step in &self.steps {
                let change = step.height - case.value;
                corner = movement.pass(corner, change, [step.seconds, step.share], &mut case.moved);
            }
        }
    }

    fn term(&self, index: usize, spike: Spike) -> EventTerm {
        let t_us = spike.t_us as f64;
        let course = &self.course;
        let position = course.position(t_us);
        let height = course.height(position);
        let speed = course.slope(position);
        let slope = if spike.on { speed } else { -speed };
        let is_awake = t_us > self.awake_us;
        let behind_s = (t_us - self.fired_us) * 1e-6;
        let rested = course.law.rested([behind_s; 2]);
        let here = Here { height, speed, rested };
        let sets_off = || self.memory.sets_off(course, spike.on, self.reach, here);
        let hazard = if is_awake { sets_off() } else { 0.0 };
        let background = course.law.background_hz(spike.on).max(LEAST_HAZARD);
        EventTerm {
            index,
            block: self.blocks.of(t_us),
            spike,
            log_hazard: (hazard + background).ln(),
            background_share: background / (hazard + background),
            spent: self.spent,
            change: self.memory.change(height, spike.on),
            slope_per_s: slope,
            level: course.level(position),
        }
    }
}
