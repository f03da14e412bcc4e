//! Background activity: the rate of events that have no other event near in space and time.
//!
//! Independent noise and isolation are separate by Mecke's formula: the expected number of isolated
//! events is the rate times the time during which a pixel's surroundings are empty. That time is
//! measured at random probes, so that the rate is unbiased for any window. Weak texture that moves
//! gives isolated events too: the rate bounds the noise from above.

use super::SectionResult;
use super::chance::poisson_rate;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::stats::{Estimate, SplitMix};
use serde::Serialize;

/// Probes of emptiness: their share is then known to 0.3 %.
const N_PROBES: usize = 100_000;

/// Time to either side, µs, at least and at most. The longest keeps the edges of slow motion out;
/// the shortest is longer than the readout of a busy sensor.
const WINDOW_US: [f64; 2] = [1_000.0, 100_000.0];

/// Events that are expected in the surroundings by the mean rate: about half of them are empty.
const EVENTS_PER_WINDOW: f64 = 0.5;

/// Pixels of the surroundings, the pixel itself included.
const N_SURROUNDING: f64 = 9.0;

/// Fewest empty probes for a rate with an error below a third.
const MIN_EMPTY_PROBES: u64 = 10;

const NO_PROBE: u32 = u32::MAX;

/// Rates of isolated events.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IsolatedEventRates {
    /// ON events per pixel and second; the interval is Poisson's, with the error of the time.
    pub on_hz: Estimate,
    /// OFF events per pixel and second.
    pub off_hz: Estimate,
    /// Time to either side in which the pixel and its eight neighbours have no other event, µs.
    pub window_us: f64,
    /// Share of pixel-time whose surroundings are that empty.
    pub empty_share: f64,
}

/// A random place and time.
#[derive(Debug, Clone, Copy)]
struct EmptinessProbe {
    t: i64,
    pixel: u32,
    /// The probe before it at the same pixel.
    previous: u32,
    is_empty: bool,
}

/// The last event of a pixel.
#[derive(Debug, Clone, Copy)]
struct LastPixelEvent {
    t: i64,
    /// Whether no other event was near it so far: then its polarity counts.
    is_isolated: bool,
    on: bool,
    last_probe: u32,
}

/// Measures the rates; events of hot pixels and of bursts are left out.
pub(super) fn background(
    events: EventSlice<'_>,
    size: Size,
    hot: &[bool],
    is_burst: &[bool],
) -> SectionResult<IsolatedEventRates> {
    let [first, last] = [events.t.first(), events.t.last()].map(|t| t.copied().unwrap_or(0));
    let seconds = (last - first) as f64 * 1e-6;
    let n_hot = hot.iter().filter(|hot| **hot).count();
    let n_pixels = size.n_pixels() - n_hot;
    let rate = events.len() as f64 / (seconds * n_pixels as f64).max(1e-9);
    let window_us =
        (EVENTS_PER_WINDOW / (2.0 * N_SURROUNDING * rate) * 1e6).clamp(WINDOW_US[0], WINDOW_US[1]);
    // Near the ends of the recording, the surroundings are not known.
    let window = window_us as i64;
    let inner = [first + window, last - window];
    if inner[1] <= inner[0] || n_pixels == 0 {
        return SectionResult::not_measured(format!(
            "too short for background activity: {seconds:.3} s, more than {:.3} s are needed",
            2e-6 * window_us
        ));
    }
    let mut walk = SurroundingsWalk::new(size, hot, window, inner);
    for i in 0..events.len() {
        let pixel = size.index(events.x[i], events.y[i]);
        let is_left_out =
            hot.get(pixel).copied().unwrap_or(false) || is_burst.get(i).copied().unwrap_or(false);
        if !is_left_out {
            walk.event(events.t[i], events.x[i], events.y[i], events.on[i]);
        }
    }
    walk.finish(seconds_between(inner) * n_pixels as f64)
}

fn seconds_between([from, to]: [i64; 2]) -> f64 {
    (to - from) as f64 * 1e-6
}

/// Events and probes in order of time, with the last of either at each pixel.
struct SurroundingsWalk {
    size: Size,
    window: i64,
    inner: [i64; 2],
    states: Vec<LastPixelEvent>,
    probes: Vec<EmptinessProbe>,
    next_probe: usize,
    n_isolated: [u64; 2],
}

impl SurroundingsWalk {
    fn new(size: Size, hot: &[bool], window: i64, inner: [i64; 2]) -> Self {
        let mut random = SplitMix::new(3, inner[0] as u64);
        let length = (inner[1] - inner[0]) as f64;
        let probe = |_| {
            let t = inner[0] + (random.uniform() * length) as i64;
            let pixel = random.below(size.n_pixels()) as u32;
            EmptinessProbe { t, pixel, previous: NO_PROBE, is_empty: true }
        };
        let mut probes: Vec<EmptinessProbe> = (0..N_PROBES).map(probe).collect();
        probes.retain(|probe| !hot.get(probe.pixel as usize).copied().unwrap_or(false));
        probes.sort_by_key(|probe| probe.t);
        let nothing =
            LastPixelEvent { t: i64::MIN / 2, is_isolated: false, on: false, last_probe: NO_PROBE };
        let states = vec![nothing; size.n_pixels()];
        Self { size, window, inner, states, probes, next_probe: 0, n_isolated: [0; 2] }
    }

    fn event(&mut self, t: i64, x: u16, y: u16, on: bool) {
        while self.probes.get(self.next_probe).is_some_and(|probe| probe.t <= t) {
            self.probe(self.next_probe);
            self.next_probe += 1;
        }
        let mut is_isolated = true;
        let own = self.size.index(x, y);
        for v in y.saturating_sub(1)..y.saturating_add(2).min(self.size.height) {
            for u in x.saturating_sub(1)..x.saturating_add(2).min(self.size.width) {
                let pixel = self.size.index(u, v);
                if t - self.states[pixel].t <= self.window {
                    is_isolated = false;
                    self.states[pixel].is_isolated = false;
                }
                self.spoil_probes(pixel, t);
            }
        }
        self.settle(own);
        let state = &mut self.states[own];
        (state.t, state.on) = (t, on);
        state.is_isolated = is_isolated && t >= self.inner[0] && t < self.inner[1];
    }

    /// Counts the last event of a pixel if nothing came near it.
    fn settle(&mut self, pixel: usize) {
        let state = &mut self.states[pixel];
        if std::mem::take(&mut state.is_isolated) {
            self.n_isolated[usize::from(!state.on)] += 1;
        }
    }

    /// Marks the probes of a pixel that an event is near to.
    fn spoil_probes(&mut self, pixel: usize, t: i64) {
        let mut at = std::mem::replace(&mut self.states[pixel].last_probe, NO_PROBE);
        while let Some(probe) = self.probes.get_mut(at as usize) {
            if t - probe.t > self.window {
                break;
            }
            probe.is_empty = false;
            at = probe.previous;
        }
    }

    /// Takes a probe: whether the surroundings were empty before it.
    fn probe(&mut self, index: usize) {
        let EmptinessProbe { t, pixel, .. } = self.probes[index];
        let width = u32::from(self.size.width);
        let [x, y] = [(pixel % width) as u16, (pixel / width) as u16];
        for v in y.saturating_sub(1)..y.saturating_add(2).min(self.size.height) {
            for u in x.saturating_sub(1)..x.saturating_add(2).min(self.size.width) {
                if t - self.states[self.size.index(u, v)].t <= self.window {
                    self.probes[index].is_empty = false;
                }
            }
        }
        let state = &mut self.states[pixel as usize];
        self.probes[index].previous = std::mem::replace(&mut state.last_probe, index as u32);
    }

    fn finish(mut self, pixel_seconds: f64) -> SectionResult<IsolatedEventRates> {
        while self.next_probe < self.probes.len() {
            self.probe(self.next_probe);
            self.next_probe += 1;
        }
        (0..self.states.len()).for_each(|pixel| self.settle(pixel));
        let n = self.probes.len() as f64;
        let n_empty = self.probes.iter().filter(|probe| probe.is_empty).count() as u64;
        if n_empty < MIN_EMPTY_PROBES {
            return SectionResult::not_measured(format!(
                "too busy for background activity: the surroundings of a pixel are empty in \
                 {n_empty} of {n} random looks, at least {MIN_EMPTY_PROBES} are needed"
            ));
        }
        let empty_share = n_empty as f64 / n;
        let relative = ((1.0 - empty_share) / n_empty as f64).sqrt();
        let rate = |n_isolated: u64| {
            let counted = poisson_rate(n_isolated, pixel_seconds * empty_share);
            let [low, high] = counted.ci90;
            Estimate {
                standard_error: counted.standard_error.hypot(relative * counted.value),
                ci90: [low * (1.0 - relative), high * (1.0 + relative)],
                ..counted
            }
        };
        let [on_hz, off_hz] = self.n_isolated.map(rate);
        let window_us = self.window as f64;
        SectionResult::Known(IsolatedEventRates { on_hz, off_hz, window_us, empty_share })
    }
}
