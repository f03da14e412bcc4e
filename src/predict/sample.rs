//! Drawing events from a pixel's law: the model turned round, for tests and for the null.

use super::movement::Movement;
use super::threshold::{Threshold, softplus};
use super::{Light, PixelLaw, Spike};
use crate::stats::SplitMix;

/// The most events a pixel may make in a second, so that an absurd law ends.
const MAX_PER_S: f64 = 20_000.0;

/// Events of one pixel drawn from its law, from the window's start to `end_us` where the light is
/// known. The same sequence of random numbers gives the same events.
#[must_use]
pub fn sample(law: &PixelLaw, light: Light<'_>, end_us: i64, random: &mut SplitMix) -> Vec<Spike> {
    let mut spikes = Vec::new();
    for run in light.known() {
        let at = |index: usize| light.start_us + index as f64 * light.step_us;
        let [from, to] = [at(run[0]).max(0.0), at(run[1]).min(end_us as f64)];
        let most = (MAX_PER_S * (to - from).max(0.0) * 1e-6) as usize + 1;
        let limit = spikes.len() + most;
        let mut source = Source { law, light, run, random: &mut *random };
        let mut fired = source.first(from, to);
        while let Some(spike) = fired.filter(|_| spikes.len() < limit) {
            spikes.push(spike);
            fired = source.next(spike, to);
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
    for run in light.known() {
        let at = |index: usize| light.start_us + index as f64 * light.step_us;
        let [from, to] = [at(run[0]).max(0.0), at(run[1]).min(end_us as f64)];
        let first = spikes.partition_point(|spike| (spike.t_us as f64) < from);
        let last = spikes.partition_point(|spike| spike.t_us as f64 <= to);
        let mut source = Source { law, light, run, random: &mut *random };
        for before in first..last {
            let start = source.behind(spikes[before], to);
            let drawn = source.fire(&start, spikes[before].t_us as f64, to);
            let real = (before + 1 < last).then(|| spikes[before + 1]);
            all.push(Followed {
                before,
                real: real.map(|spike| source.moment(&start, spike)),
                drawn: drawn.map(|spike| source.moment(&start, spike)),
            });
        }
    }
    all
}

struct Source<'a> {
    law: &'a PixelLaw,
    light: Light<'a>,
    run: [usize; 2],
    random: &'a mut SplitMix,
}

/// Where the pixel stands at the start of a silence.
struct Start {
    awake_us: f64,
    value: f64,
    /// Distances at which it fires, On and Off.
    at: [f64; 2],
    /// The noise's own movement; none while the memory is not known.
    moves: Option<Movement>,
    /// When background fires, whatever the light does.
    background: Spike,
    /// While the memory is not known one store serves both sides: the sum of the extremes.
    shared: Option<f64>,
}

impl Source<'_> {
    fn position(&self, t_us: f64) -> f64 {
        (t_us - self.light.start_us) / self.light.step_us
    }

    fn noise_at(&self, t_us: f64) -> f64 {
        let i = (self.position(t_us).max(0.0) as usize).clamp(self.run[0], self.run[1]);
        self.law.noise(f64::from(self.light.level[i]))
    }

    /// The first event from `from_us` on, when nothing is known of the memory.
    fn first(&mut self, from_us: f64, to_us: f64) -> Option<Spike> {
        let noise = self.noise_at(from_us);
        let sum = self.law.theta_on + self.law.theta_off;
        // The sum of the extremes at which softplus has fallen by a uniform factor.
        let left = softplus(sum / noise) * self.random.uniform();
        let shared = sum - noise * left.exp_m1().max(1e-300).ln();
        let start = Start {
            awake_us: from_us,
            value: self.light.at(self.position(from_us), self.run),
            at: [f64::INFINITY; 2],
            moves: None,
            background: self.background(from_us),
            shared: Some(shared),
        };
        self.fire(&start, from_us, to_us)
    }

    fn next(&mut self, spike: Spike, to_us: f64) -> Option<Spike> {
        let start = self.behind(spike, to_us);
        self.fire(&start, spike.t_us as f64, to_us)
    }

    /// Where the pixel stands behind an event.
    fn behind(&mut self, spike: Spike, to_us: f64) -> Start {
        let fired_us = spike.t_us as f64;
        let awake_us = fired_us + self.law.blind_s * 1e6;
        let memorised_us = awake_us.min(to_us);
        let position = self.position(memorised_us);
        let slope = self.light.slope(position, self.run) + self.law.leak_per_s;
        let i = (position.max(0.0) as usize).clamp(self.run[0], self.run[1]);
        let noise = self.law.noise_on(f64::from(self.light.level[i]), slope);
        let law = *self.law;
        let mut draw = |theta| {
            Threshold::new(theta, noise, law.drop_fraction).at_spent(self.random.exponential())
        };
        let at = [draw(law.theta_on), draw(law.theta_off)];
        Start {
            awake_us,
            value: self.light.at(self.position(memorised_us), self.run),
            at,
            moves: Movement::new(&law, noise),
            background: self.background(fired_us),
            shared: None,
        }
    }

    /// What the light has done by the time of an event, in the event's own direction.
    fn moment(&self, start: &Start, spike: Spike) -> Moment {
        let position = self.position(spike.t_us as f64);
        let towards = if spike.on { 1.0 } else { -1.0 };
        let i = (position.max(0.0) as usize).clamp(self.run[0], self.run[1]);
        Moment {
            spike,
            change: towards * self.change(start, position),
            slope_per_s: towards * (self.light.slope(position, self.run) + self.law.leak_per_s),
            level: f64::from(self.light.level[i]),
        }
    }

    fn background(&mut self, from_us: f64) -> Spike {
        let [on, off] = [self.law.background_on_hz, self.law.background_off_hz];
        let wait_s = self.random.exponential() / (on + off).max(1e-12);
        let is_on = self.random.uniform() * (on + off) < on;
        let t_us = (from_us + wait_s * 1e6).min(9e15).ceil() as i64;
        Spike { t_us, on: is_on }
    }

    /// The event that comes first; `None` when none comes before `to_us`.
    fn fire(&mut self, start: &Start, from_us: f64, to_us: f64) -> Option<Spike> {
        let crossing = self.crossing(start, to_us);
        let background = Some(start.background).filter(|spike| (spike.t_us as f64) < to_us);
        let spike = match (crossing, background) {
            (Some(a), Some(b)) => Some(if a.t_us <= b.t_us { a } else { b }),
            (a, b) => a.or(b),
        };
        // Stamps are whole microseconds, and each later than the one before it.
        spike.map(|spike| Spike { t_us: spike.t_us.max(from_us as i64 + 1), ..spike })
    }

    fn change(&self, start: &Start, position: f64) -> f64 {
        let seconds = (position - self.position(start.awake_us)) * self.light.step_us * 1e-6;
        self.light.at(position, self.run) - start.value + self.law.leak_per_s * seconds
    }

    fn crossing(&mut self, start: &Start, to_us: f64) -> Option<Spike> {
        if start.awake_us >= to_us {
            return None;
        }
        let (mut at, end) = (self.position(start.awake_us), self.position(to_us));
        let mut before = self.change(start, at);
        let mut extremes = [before.max(0.0), (-before).max(0.0)];
        let (mut on_store, mut off_store) = (self.random.exponential(), self.random.exponential());
        while at < end {
            let next = (at.floor() + 1.0).min(end);
            let after = self.change(start, next);
            let step_s = (next - at) * self.light.step_us * 1e-6;
            let mut first: Option<(f64, bool)> = None;
            let mut offer = |share: f64, on: bool| {
                if first.is_none_or(|(earliest, _)| share < earliest) {
                    first = Some((share, on));
                }
            };
            for (side, on) in [(0, true), (1, false)] {
                let sign = if on { 1.0 } else { -1.0 };
                let (a, b) = (sign * before, sign * after);
                let limit = match start.shared {
                    Some(sum) => sum - extremes[1 - side],
                    None => start.at[side],
                };
                if b >= limit && b > a && b > extremes[side] {
                    offer(((limit - a) / (b - a)).clamp(0.0, 1.0), on);
                }
            }
            if let Some(moves) = start.moves {
                let speed = (after - before) / step_s;
                let middle = 0.5 * (before + after);
                for (on, y, store) in
                    [(true, middle, &mut on_store), (false, -middle, &mut off_store)]
                {
                    let hazard = moves.hazard(y, speed, on) * step_s;
                    if hazard > *store {
                        offer(*store / hazard, on);
                    }
                    *store -= hazard;
                }
            }
            if let Some((share, on)) = first {
                let position = at + share * (next - at);
                let t_us = self.light.start_us + position * self.light.step_us;
                return Some(Spike { t_us: t_us.round() as i64, on });
            }
            extremes = [extremes[0].max(after), extremes[1].max(-after)];
            (before, at) = (after, next);
        }
        None
    }
}
