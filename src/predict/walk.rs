//! One pass over a pixel's light and events: every event's hazard, every silence's compensator.

use super::movement::Movement;
use super::threshold::{Threshold, logistic, softplus};
use super::{Blocks, Light, PixelLaw, Spike};

/// The least hazard an event is given, a second: with it a score is a number whatever happened.
const LEAST_HAZARD: f64 = 1e-9;

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
    for run in light.known() {
        let at = |index: usize| light.start_us + index as f64 * light.step_us;
        let [from, to] = [at(run[0]).max(0.0), at(run[1]).min(blocks.length_us() as f64)];
        if from < to {
            Pass::new(law, light, run, from, blocks).run(spikes, to, witness);
        }
    }
}

/// The state of a pixel on its way through one known stretch of its light.
struct Pass<'a> {
    law: &'a PixelLaw,
    light: Light<'a>,
    run: [usize; 2],
    blocks: &'a Blocks,
    /// Up to here, microseconds, the pass has come.
    now_us: f64,
    /// The pixel sees changes from here on; later than now while it is blind.
    awake_us: f64,
    memory: Memory,
    /// Extremes of the change since it was memorised: towards On, towards Off.
    maxima: [f64; 2],
    /// What they had spent when silence was last reported.
    reported: [f64; 2],
    /// Spent by the noise's own movement and not reported yet, On and Off.
    moved: [f64; 2],
    /// All that was spent since the last event.
    spent: f64,
}

/// What the pixel compares with.
enum Memory {
    /// Nothing is known of what it memorised: it lies anywhere between the thresholds.
    Unknown { value: f64, noise: f64, sum: f64 },
    /// It memorised `value`.
    Known { value: f64, on: Threshold, off: Threshold, noise: f64 },
}

impl Memory {
    fn value(&self) -> f64 {
        match self {
            Self::Unknown { value, .. } | Self::Known { value, .. } => *value,
        }
    }

    /// What the maxima have spent, On and Off. While nothing is known both share one store, which
    /// is booked to the side that moved further.
    fn spent(&self, [up, down]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Known { on, off, .. } => [on.spent(up), off.spent(down)],
            Self::Unknown { noise, sum, .. } => {
                let left = softplus((sum - up - down) / noise) / softplus(sum / noise);
                let all = -left.max(1e-300).ln();
                let share = if up + down > 0.0 { up / (up + down) } else { 0.5 };
                [all * share, all * (1.0 - share)]
            }
        }
    }

    /// Hazard per unit of a maximum.
    fn hazard(&self, on: bool, [up, down]: [f64; 2]) -> f64 {
        match self {
            Self::Known { on: law, .. } if on => law.hazard(up),
            Self::Known { off: law, .. } => law.hazard(down),
            Self::Unknown { noise, sum, .. } => {
                let z = (sum - up - down) / noise;
                logistic(z) / (noise * softplus(z).max(1e-300))
            }
        }
    }
}

impl<'a> Pass<'a> {
    fn new(
        law: &'a PixelLaw,
        light: Light<'a>,
        run: [usize; 2],
        from_us: f64,
        blocks: &'a Blocks,
    ) -> Self {
        let mut pass = Self {
            law,
            light,
            run,
            blocks,
            now_us: from_us,
            awake_us: from_us,
            memory: Memory::Unknown { value: 0.0, noise: 1.0, sum: 1.0 },
            maxima: [0.0; 2],
            reported: [0.0; 2],
            moved: [0.0; 2],
            spent: 0.0,
        };
        let position = pass.position(from_us);
        let value = light.at(position, run);
        let noise = law.noise(pass.level(position));
        pass.memory = Memory::Unknown { value, noise, sum: law.theta_on + law.theta_off };
        pass
    }

    fn run(mut self, spikes: &[Spike], to_us: f64, witness: &mut impl Witness) {
        let first = spikes.partition_point(|spike| (spike.t_us as f64) < self.now_us);
        for (index, &spike) in spikes.iter().enumerate().skip(first) {
            let t_us = spike.t_us as f64;
            if t_us > to_us {
                break;
            }
            self.silence(t_us, witness);
            witness.event(&self.term(index, spike));
            self.memorise(t_us + self.law.blind_s * 1e6, to_us);
        }
        self.silence(to_us, witness);
    }

    fn position(&self, t_us: f64) -> f64 {
        (t_us - self.light.start_us) / self.light.step_us
    }

    fn level(&self, position: f64) -> f64 {
        let i = (position.max(0.0) as usize).clamp(self.run[0], self.run[1]);
        f64::from(self.light.level[i])
    }

    /// Rate of change of the signal and its leak, log intensity a second.
    fn slope(&self, position: f64) -> f64 {
        self.light.slope(position, self.run) + self.law.leak_per_s
    }

    /// Change of the signal since it was memorised, at a position.
    fn change(&self, position: f64) -> f64 {
        let seconds = (position - self.position(self.awake_us)) * self.light.step_us * 1e-6;
        self.light.at(position, self.run) - self.memory.value() + self.law.leak_per_s * seconds
    }

    /// The pixel takes the light at `t_us` for its new reference.
    fn memorise(&mut self, t_us: f64, end_us: f64) {
        self.awake_us = t_us;
        let position = self.position(t_us.min(end_us));
        let noise = self.law.noise_on(self.level(position), self.slope(position));
        let law = self.law;
        self.memory = Memory::Known {
            value: self.light.at(position, self.run),
            on: Threshold::new(law.theta_on, noise, law.drop_fraction),
            off: Threshold::new(law.theta_off, noise, law.drop_fraction),
            noise,
        };
        self.maxima = [0.0; 2];
        self.reported = [0.0; 2];
        self.moved = [0.0; 2];
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
            self.follow(self.position(start), self.position(to_us));
        }
        self.now_us = to_us;
        let now_spent = self.memory.spent(self.maxima);
        let seconds = (to_us - from_us) * 1e-6;
        let part = |side: usize, on: bool| {
            let crossed = now_spent[side] - self.reported[side];
            crossed + self.moved[side] + self.law.background_hz(on) * seconds
        };
        let (on, off) = (part(0, true), part(1, false));
        self.reported = now_spent;
        self.moved = [0.0; 2];
        Stretch { block, from_us, to_us, on, off }
    }

    /// Follows the change between two positions: its extremes, and what the noise's own movement
    /// spends on the way.
    fn follow(&mut self, from: f64, to: f64) {
        let first = from.floor() as usize + 1;
        let last = (to.floor().max(0.0) as usize).min(self.run[1]);
        let leak = self.law.leak_per_s * self.light.step_us * 1e-6;
        let zero = self.position(self.awake_us) * leak + self.memory.value();
        let between = self.light.signal.get(first..=last).unwrap_or_default();
        let [begin, end] = [self.change(from), self.change(to)];
        let [mut up, mut down] = self.maxima;
        let mut reach = |y: f64| (up, down) = (up.max(y), down.max(-y));
        reach(begin);
        reach(end);
        if let Some(movement) = self.movement() {
            let mut moved = self.moved;
            let step_s = self.light.step_us * 1e-6;
            let (mut before, mut at) = (begin, from);
            for (j, &signal) in between.iter().enumerate() {
                let j = (first + j) as f64;
                let y = f64::from(signal) + leak * j - zero;
                reach(y);
                movement.pass([before, y], (j - at) * step_s, &mut moved);
                (before, at) = (y, j);
            }
            movement.pass([before, end], (to - at) * step_s, &mut moved);
            self.moved = moved;
        } else {
            for (j, &signal) in between.iter().enumerate() {
                reach(f64::from(signal) + leak * (first + j) as f64 - zero);
            }
        }
        self.maxima = [up, down];
    }

    /// The noise's own movement, where it moves the signal at all.
    fn movement(&self) -> Option<Movement> {
        let Memory::Known { noise, .. } = self.memory else { return None };
        Movement::new(self.law, noise)
    }

    fn term(&self, index: usize, spike: Spike) -> EventTerm {
        let t_us = spike.t_us as f64;
        let position = self.position(t_us);
        let towards = if spike.on { 1.0 } else { -1.0 };
        let speed = self.slope(position);
        let slope = towards * speed;
        let is_awake = t_us > self.awake_us;
        let change = towards * self.change(position);
        let maximum = self.maxima[usize::from(!spike.on)];
        let mut hazard = 0.0;
        if is_awake && slope > 0.0 && change >= maximum {
            hazard += self.memory.hazard(spike.on, self.maxima) * slope;
        }
        if let Some(moves) = self.movement().filter(|_| is_awake) {
            hazard += moves.hazard(change, speed, spike.on);
        }
        let background = self.law.background_hz(spike.on).max(LEAST_HAZARD);
        let is_known = matches!(self.memory, Memory::Known { .. });
        EventTerm {
            index,
            block: self.blocks.of(t_us),
            spike,
            log_hazard: (hazard + background).ln(),
            background_share: background / (hazard + background),
            spent: self.spent,
            change: is_known.then_some(change),
            slope_per_s: slope,
            level: self.level(position),
        }
    }
}
