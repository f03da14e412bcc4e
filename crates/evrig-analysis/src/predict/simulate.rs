//! Drawing events from a pixel's law: the model turned round, for tests and for the null.

use super::course::{Course, Reach};
use super::memory::{Case, Fired, Memory, Unknown, fresh};
use super::movement::Movement;
use super::walk::Pass;
use super::{Blocks, EventTerm, Light, PixelLaw, Spike, Stretch, Witness};
use evrig_core::stats::SplitMix;

/// The most events a pixel may make in a second, so that an absurd law ends.
const MAX_PER_S: f64 = 20_000.0;

/// Events of one pixel drawn from its law, from the window's start to `end_us` where the light is
/// known. The same sequence of random numbers gives the same events.
#[must_use]
pub fn sample(law: &PixelLaw, light: Light<'_>, end_us: i64, random: &mut SplitMix) -> Vec<Spike> {
    let mut spikes = Vec::new();
    for (run, [from, to]) in light.stretches(end_us) {
        let most = (MAX_PER_S * (to - from).max(0.0) * 1e-6) as usize + 1;
        let mut source = Source::new(law, light, run, to, &mut *random);
        let mut start = source.first(from);
        let mut heard_us = from;
        for _ in 0..most {
            let Some(drawn) = source.next(&start) else { break };
            let t_us = drawn.spike.t_us as f64;
            if t_us >= heard_us && !source.is_lost() {
                spikes.push(drawn.spike);
                heard_us = t_us + law.masked_s * 1e6;
            }
            start = source.behind(&start, drawn);
        }
    }
    spikes
}

/// An event and what the light had done by then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The event.
    pub spike: Spike,
    /// Change of the light since the event before, in this one's own direction, log intensity.
    pub change: f64,
    /// Speed of the light in the event's direction, log intensity a second.
    pub slope_per_s: f64,
    /// Log intensity over white.
    pub level: f64,
}

/// What followed an event, and what the law would have had follow it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed {
    /// Number of the event that both follow.
    pub before: usize,
    /// The event that came next; none when the known light ended first.
    pub real: Option<Moment>,
    /// One drawn from the law behind the same past.
    pub drawn: Option<Moment>,
}

/// For each event, what came next and a next event drawn from the law. If the law is true the two
/// are alike, whatever one looks at that is known without the pixel's later events.
#[must_use]
pub fn followed(
    law: &PixelLaw,
    light: Light<'_>,
    spikes: &[Spike],
    end_us: i64,
    random: &mut SplitMix,
) -> Vec<Followed> {
    let mut all = Vec::new();
    let blocks = Blocks::new(end_us, 1);
    for (run, [from, to]) in light.stretches(end_us) {
        let first = spikes.partition_point(|spike| (spike.t_us as f64) < from);
        let last = spikes.partition_point(|spike| spike.t_us as f64 <= to);
        let course = Course::new(law, light, run);
        let mut source = Source::new(law, light, run, to, &mut *random);
        let mut pass = Pass::new(course, from, &blocks);
        for before in first..last {
            pass.take(before, spikes[before], to, &mut Nobody);
            let (memory, awake_us) = pass.memory();
            let real = (before + 1 < last).then(|| spikes[before + 1]);
            let drawn = source.heard(memory, spikes[before], awake_us);
            // Against what the pixel most likely compares with, whatever it was drawn to.
            let Some(known) = memory.cases().first() else { continue };
            let moment = |spike| moment(&course, known, spike);
            let (real, drawn) = (real.map(moment), drawn.map(moment));
            all.push(Followed { before, real, drawn });
        }
    }
    all
}

struct Nobody;

impl Witness for Nobody {
    fn silence(&mut self, _: &Stretch) {}
    fn event(&mut self, _: &EventTerm) {}
}

/// What the light has done by the time of an event, in the event's own direction.
fn moment(course: &Course<'_>, case: &Case, spike: Spike) -> Moment {
    let position = course.position(spike.t_us as f64);
    let slope = course.slope(position);
    Moment {
        spike,
        change: case.change(course.height(position), spike.on),
        slope_per_s: if spike.on { slope } else { -slope },
        level: course.level(position),
    }
}

struct Source<'a> {
    course: Course<'a>,
    /// End of the known light, microseconds.
    to: f64,
    random: &'a mut SplitMix,
}

/// Where the pixel stands at the start of a silence.
struct Start {
    /// What it compares with; none while nothing is known of it.
    case: Option<Case>,
    /// When the light sets off the next event, and when background does, whatever the light does.
    crossing: Option<Spike>,
    background: Spike,
}

/// An event that was drawn.
#[derive(Clone, Copy)]
struct Drawn {
    spike: Spike,
    is_background: bool,
}

/// Where the light would set off an event.
struct Limits {
    from_us: f64,
    value: f64,
    /// Distances at which the pixel fires, On and Off.
    at: [f64; 2],
    /// While the memory is not known one store serves both sides: the sum of the extremes.
    shared: Option<f64>,
    /// The noise's own movement; none while the memory is not known.
    moves: Option<Movement>,
}

impl<'a> Source<'a> {
    /// Noise may set off an event anywhere on a straight piece, so that it looks at every instant.
    fn new(
        law: &'a PixelLaw,
        light: Light<'a>,
        run: [usize; 2],
        to: f64,
        random: &'a mut SplitMix,
    ) -> Self {
        Self { course: Course::new(law, Light { bends: None, ..light }, run), to, random }
    }

    /// Where a pixel stands at first, when nothing is known of its memory.
    fn first(&mut self, from_us: f64) -> Start {
        let position = self.course.position(from_us);
        let unknown = Unknown::new(&self.course, position);
        let shared = Some(unknown.span_at(self.random.uniform()));
        let at = [f64::INFINITY; 2];
        let limits = Limits { from_us, value: unknown.value, at, shared, moves: None };
        let crossing = self.crossing(&limits);
        Start { case: None, crossing, background: self.background(from_us) }
    }

    /// Where it stands when it compares as `case` says from `awake_us` on, having fired at `t_us`.
    fn start(&mut self, case: Case, t_us: i64, awake_us: f64) -> Start {
        let mut draw = |side: usize| {
            let spent = case.spent_before(side) + self.random.exponential();
            case.thresholds[side].at_spent(spent)
        };
        let at = [draw(0), draw(1)];
        let moves = case.movement(&self.course);
        let limits = Limits { from_us: awake_us, value: case.value, at, shared: None, moves };
        let crossing = self.crossing(&limits);
        let crossing = crossing.map(|spike| Spike { t_us: spike.t_us.max(t_us + 1), ..spike });
        Start { case: Some(case), crossing, background: self.background(t_us as f64) }
    }

    /// Where it stands behind an event that was drawn from where it stood before.
    fn behind(&mut self, before: &Start, drawn: Drawn) -> Start {
        let Spike { t_us, on } = drawn.spike;
        let law = self.course.law;
        let passes_by = drawn.is_background
            && law.background_memorised < 1.0
            && self.random.uniform() >= law.background_memorised;
        if passes_by {
            let background = self.background(t_us as f64);
            return Start { background, ..*before };
        }
        let height = self.course.height(self.course.position(t_us as f64));
        let change = before.case.map(|case| case.change(height, on));
        let background_share = f64::from(u8::from(drawn.is_background));
        let fired = Fired { t_us: t_us as f64, on, background_share };
        let case = fresh(&self.course, fired, change, self.to);
        self.start(case, t_us, t_us as f64 + law.blind_s * 1e6)
    }

    /// The next event that is heard behind one of the recording.
    fn heard(&mut self, memory: &Memory, behind: Spike, awake_us: f64) -> Option<Spike> {
        let mut left = self.random.uniform();
        let (first, others) = memory.cases().split_first()?;
        let mut case = *first;
        for other in others {
            left -= case.weight;
            if left < 0.0 {
                break;
            }
            case = *other;
        }
        let mut start = self.start(case, behind.t_us, awake_us);
        let mut drawn = self.next(&start)?;
        while self.is_lost() {
            start = self.behind(&start, drawn);
            drawn = self.next(&start)?;
        }
        Some(drawn.spike)
    }

    /// Whether an event that the pixel fired is lost.
    fn is_lost(&mut self) -> bool {
        let share = self.course.law.drop_fraction;
        share > 0.0 && self.random.uniform() < share
    }

    fn background(&mut self, from_us: f64) -> Spike {
        let law = self.course.law;
        let [on, off] = [law.background_on_hz, law.background_off_hz];
        let wait_s = self.random.exponential() / (on + off).max(1e-12);
        let is_on = self.random.uniform() * (on + off) < on;
        let t_us = (from_us + wait_s * 1e6).min(9e15).ceil() as i64;
        // Stamps are whole microseconds, and each later than the one before it.
        Spike { t_us: t_us.max(from_us as i64 + 1), on: is_on }
    }

    /// The event that comes first; `None` when none comes before the light ends.
    fn next(&self, start: &Start) -> Option<Drawn> {
        let background = Some(start.background).filter(|spike| (spike.t_us as f64) < self.to);
        let drawn = |spike, is_background| Drawn { spike, is_background };
        match (start.crossing, background) {
            (Some(a), Some(b)) if b.t_us < a.t_us => Some(drawn(b, true)),
            (Some(a), _) => Some(drawn(a, false)),
            (None, b) => b.map(|b| drawn(b, true)),
        }
    }

    /// The first event that the light sets off.
    fn crossing(&mut self, limits: &Limits) -> Option<Spike> {
        if limits.from_us >= self.to {
            return None;
        }
        let course = self.course;
        let (mut at, end) = (course.position(limits.from_us), course.position(self.to));
        let mut before = course.height(at) - limits.value;
        let mut reach = Reach::at(before);
        reach.add(0.0);
        let mut stores = [self.random.exponential(), self.random.exponential()];
        for (next, height) in course.instants(at, end).chain([(end, course.height(end))]) {
            let after = height - limits.value;
            let seconds = (next - at) * course.step_s();
            let behind = [at, next].map(|p| (course.time_us(p) - limits.from_us) * 1e-6);
            let times = [seconds, course.law.rested(behind)];
            if let Some((share, on)) = limits.passed([before, after], reach, times, &mut stores) {
                let t_us = course.time_us(at + share * (next - at));
                return Some(Spike { t_us: t_us.round() as i64, on });
            }
            reach.add(after);
            (before, at) = (after, next);
        }
        None
    }
}

impl Limits {
    /// Where on a straight passage the first event comes, as a share of it, and which. The passage takes so
    /// many seconds, in which noise has so much of its rate.
    fn passed(
        &self,
        [before, after]: [f64; 2],
        reach: Reach,
        [seconds, rested]: [f64; 2],
        stores: &mut [f64; 2],
    ) -> Option<(f64, bool)> {
        let mut first: Option<(f64, bool)> = None;
        let mut offer = |share: f64, on: bool| {
            if first.is_none_or(|(earliest, _)| share < earliest) {
                first = Some((share, on));
            }
        };
        let extremes = [reach.high, -reach.low];
        for (side, on) in [(0, true), (1, false)] {
            let sign = if on { 1.0 } else { -1.0 };
            let (a, b) = (sign * before, sign * after);
            let limit = self.shared.map_or(self.at[side], |sum| sum - extremes[1 - side]);
            if b >= limit && b > a && b > extremes[side] {
                offer(((limit - a) / (b - a)).clamp(0.0, 1.0), on);
            }
        }
        if let Some(moves) = self.moves.filter(|_| seconds > 0.0) {
            let speed = (after - before) / seconds;
            let middle = 0.5 * (before + after);
            for (store, (on, y)) in stores.iter_mut().zip([(true, middle), (false, -middle)]) {
                let hazard = moves.hazard(y, speed, on, rested) * seconds;
                if hazard > *store {
                    offer(*store / hazard, on);
                }
                *store -= hazard;
            }
        }
        first
    }
}
