//! One event pixel through a slab of time.

use super::circuit::{Circuit, CircuitState, StepConstants};
use super::comparator::{Comparator, ComparatorSegment, ComparatorState};
use super::pixel_input::{PixelInput, input_bounds, pixel_input};
use super::slab::Slab;
use super::slab_scene::{PixelBuffers, SlabScene};
use crate::world::draws::{RandomPurpose, WorldRandom};

/// What makes a pixel differ from its neighbours.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelTraits {
    pub(super) comparator: Comparator,
    /// Rates of the leak towards ON in log units a second: constant, at white, growth a second.
    pub(super) leak: [f64; 3],
    pub(super) is_dead: bool,
    /// Whether the pixels' own effects reach it.
    pub(super) is_affected: bool,
    pub(super) latency: f64,
}

/// What a pixel remembers from slab to slab.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PixelState {
    memory: CircuitState,
    held: ComparatorState,
    /// What has leaked so far, in log units.
    leaked: f64,
    /// Reflectance times gain at the last look.
    seen: f32,
    has_begun: bool,
}

/// A pixel's wish to send an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct EventRequest {
    /// World time in nanoseconds.
    pub(super) at_ns: i64,
    /// Row-major number of the pixel.
    pub(super) pixel: u32,
    pub(super) on: bool,
}

impl PixelState {
    /// Runs pixel number `pixel` through the slab; its requests go to `out`.
    pub(super) fn run(
        &mut self,
        pixel: usize,
        traits: &PixelTraits,
        circuit: &Circuit,
        scene: &SlabScene<'_>,
        scratch: &mut PixelBuffers,
        out: &mut Vec<EventRequest>,
    ) {
        if traits.is_dead {
            return;
        }
        if self.is_quiet(pixel, traits, circuit, scene, &scratch.forced) {
            return;
        }
        let pixel_input = pixel_input(pixel, scene, scratch);
        let PixelBuffers { seen, forced, pace } = scratch;
        let slab = scene.slab;
        let mut draws =
            WorldRandom::new(scene.seed, RandomPurpose::ShotNoise, pixel as u64, slab.number);
        let current = |seen: f32, light: f32| f64::from(seen * light) + circuit.dark;
        if !self.has_begun {
            let first = match pixel_input {
                PixelInput::Same(value) => value,
                PixelInput::Varies => seen[0],
            };
            self.begin(pixel, traits, circuit, current(first, slab.samples[0].light), scene.seed);
        }
        let mut fire = |time: f64, on: bool| {
            let at_ns = ((time + traits.latency) * 1e9).round() as i64;
            out.push(EventRequest { at_ns, pixel: pixel as u32, on });
        };
        let mut walk = PixelRun {
            state: self,
            traits,
            circuit,
            begin: slab.begin(),
            forced,
            pace,
            fire: &mut fire,
        };
        match pixel_input {
            PixelInput::Same(value) if slab.is_steady => {
                let now = current(value, slab.samples[0].light);
                walk.rest(now, slab, &mut draws);
            }
            PixelInput::Same(value) => {
                let mut before = current(value, slab.samples[0].light).ln();
                for pair in slab.samples.windows(2) {
                    let after = current(value, pair[1].light).ln();
                    walk.go([pair[0].since, pair[1].since], [before, after], slab, &mut draws);
                    before = after;
                }
            }
            PixelInput::Varies => {
                let mut before = current(seen[0], slab.samples[0].light).ln();
                for (pair, seen) in slab.samples.windows(2).zip(&seen[1..]) {
                    let after = current(*seen, pair[1].light).ln();
                    walk.go([pair[0].since, pair[1].since], [before, after], slab, &mut draws);
                    before = after;
                }
            }
        }
        self.seen = match pixel_input {
            PixelInput::Same(value) => value,
            PixelInput::Varies => seen.last().copied().unwrap_or(self.seen),
        };
    }

    /// Whether the slab takes an ideal pixel nowhere near its thresholds; it is then at its end.
    /// Most pixels in most slabs are, and a few looks show it.
    fn is_quiet(
        &mut self,
        pixel: usize,
        traits: &PixelTraits,
        circuit: &Circuit,
        scene: &SlabScene<'_>,
        forced: &[(f64, bool)],
    ) -> bool {
        let slab = scene.slab;
        let is_ideal = circuit.is_bare() && traits.leak == [0.0; 3] && forced.is_empty();
        if !(self.has_begun && is_ideal && slab.is_steady) {
            return false;
        }
        let Some(input_bounds) = input_bounds(pixel, scene) else { return false };
        let signal = |seen: f32| (f64::from(seen * slab.samples[0].light) + circuit.dark).ln();
        let is_quiet = [input_bounds.low, input_bounds.high]
            .into_iter()
            .all(|seen| traits.comparator.keeps_still(&self.held, signal(seen) + self.leaked));
        if is_quiet {
            self.memory.output = signal(input_bounds.last);
            self.seen = input_bounds.last;
        }
        is_quiet
    }

    /// At rest, the signal somewhere between the thresholds: pixels were not all reset at once.
    fn begin(
        &mut self,
        pixel: usize,
        traits: &PixelTraits,
        circuit: &Circuit,
        current: f64,
        seed: u64,
    ) {
        let mut draws = WorldRandom::new(seed, RandomPurpose::Phase, pixel as u64, 0);
        let phase = draws.uniform() - 0.5;
        self.memory = circuit.at_rest(current, &mut draws);
        let away = if phase > 0.0 { traits.comparator.on } else { traits.comparator.off };
        self.held.reference = self.memory.output - phase * away;
        self.has_begun = true;
    }
}

/// A pixel on its way through a slab.
struct PixelRun<'a, F: FnMut(f64, bool)> {
    state: &'a mut PixelState,
    traits: &'a PixelTraits,
    circuit: &'a Circuit,
    /// World time of the slab's beginning in seconds.
    begin: f64,
    forced: &'a [(f64, bool)],
    pace: &'a mut StepConstants,
    fire: &'a mut F,
}

impl<F: FnMut(f64, bool)> PixelRun<'_, F> {
    /// Through a whole slab in which nothing changes.
    fn rest(&mut self, current: f64, slab: &Slab, draws: &mut WorldRandom) {
        let x = current.ln();
        let leaks = self.traits.leak != [0.0; 3];
        let is_settled = self.circuit.is_bare() || self.circuit.is_settled(&self.state.memory, x);
        if is_settled {
            if leaks || !self.forced.is_empty() {
                self.piece([0.0, slab.length()], self.state.memory.output, [x; 2]);
            }
            return;
        }
        self.go([0.0, slab.length()], [x; 2], slab, draws);
    }

    /// Between two looks, in as many steps as the circuit needs.
    fn go(&mut self, since: [f64; 2], x: [f64; 2], slab: &Slab, draws: &mut WorldRandom) {
        if self.circuit.is_bare() {
            self.state.memory.output = x[1];
            self.piece(since, x[0], x);
            return;
        }
        let length = since[1] - since[0];
        let for_noise = slab.n_noise as f64 * length / slab.length();
        let is_settling = !self.circuit.is_settled(&self.state.memory, x[1]);
        let rate = if is_settling { self.circuit.settling_rate_hz(x[1].exp()) } else { 0.0 };
        let n = for_noise.max(rate * length).ceil().max(1.0);
        let mut before = self.state.memory.output;
        // Whole nanoseconds, so that looks of one length have the same constants.
        let dt = (length * 1e9).round() * 1e-9 / n;
        if self.pace.dt != dt {
            *self.pace = self.circuit.pace(dt);
        }
        let current = (0.5 * (x[0] + x[1])).exp();
        for step in 0..n as usize {
            let part = [step as f64 / n, (step + 1) as f64 / n];
            let input = part.map(|part| x[0] + (x[1] - x[0]) * part);
            let after =
                self.circuit.advance(&mut self.state.memory, input, current, self.pace, draws);
            let times = part.map(|part| since[0] + part * length);
            self.compare(times, [before, after], input);
            before = after;
        }
    }

    fn piece(&mut self, since: [f64; 2], from: f64, x: [f64; 2]) {
        self.compare(since, [from, self.state.memory.output], x);
    }

    /// A straight piece of the output, with what leaks meanwhile on top.
    fn compare(&mut self, since: [f64; 2], output: [f64; 2], x: [f64; 2]) {
        let [constant, at_white, growth] = self.traits.leak;
        let leaked = self.state.leaked;
        if self.traits.leak != [0.0; 3] {
            let light = if at_white > 0.0 { (0.5 * (x[0] + x[1])).exp() } else { 0.0 };
            let middle = self.begin + 0.5 * (since[0] + since[1]);
            let rate = (constant + at_white * light + growth * middle.max(0.0)).max(0.0);
            self.state.leaked += rate * (since[1] - since[0]);
        }
        let times = since.map(|since| self.begin + since);
        let piece = ComparatorSegment {
            from_s: times[0],
            to_s: times[1],
            from: output[0] + leaked,
            to: output[1] + self.state.leaked,
        };
        let first = self.forced.partition_point(|(time, _)| *time < times[0]);
        let last = self.forced.partition_point(|(time, _)| *time < times[1]);
        let forced = &self.forced[first..last];
        self.traits.comparator.run(&mut self.state.held, piece, forced, &mut *self.fire);
    }
}
