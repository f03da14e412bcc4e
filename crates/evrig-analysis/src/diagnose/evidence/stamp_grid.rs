//! Time stamps on a coarse grid, as from simulators with a fixed time step.
//!
//! A law in continuous time would explain the grid as physics, so events are spread uniformly over
//! their step first.

use evrig_core::event::{Event, EventSlice, Events};
use evrig_core::stats::{MeanDirection, SplitMix};
use std::f64::consts::TAU;

/// Steps that are searched. Below, stamps are fine enough for every effect; above, spreading them
/// does not help.
const STEP_RANGE_US: [f64; 2] = [20.0, 5_000.0];

/// Mean resultant length of the stamps' phases on a grid: a normal scatter of less than 1/12 step.
const MIN_MEAN_VECTOR_LENGTH: f64 = 0.88;

/// Fewest stamps that show a grid, and the most used per stretch.
const MIN_STAMPS: usize = 500;
const MAX_STAMPS: usize = 4_000;

/// Half width of the first stretch, doubled until it holds enough stamps. Long stretches need many
/// trial frequencies.
const FIRST_HALF_WIDTH_US: f64 = 20_000.0;
const MAX_FIRST_HALF_WIDTH_US: f64 = 640_000.0;

/// Share of pairs with equal stamps that lie in one row under row readout.
const MIN_SAME_ROW_SHARE: f64 = 0.9;

/// Share of pairs with equal stamps below which one event is read per step, and least share of
/// pairs one step apart then.
const MAX_SERIAL_TIE_SHARE: f64 = 0.01;
const MIN_SERIAL_STEP_SHARE: f64 = 0.3;

/// A grid of time stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampGrid {
    /// Step, microseconds.
    pub step_us: f64,
    /// One stamp of the grid, microseconds.
    zero_us: f64,
}

impl StampGrid {
    /// The grid of a recording's ascending stamps; `None` without a grid, or where a busy readout
    /// makes it.
    #[must_use]
    pub fn of_events(events: EventSlice<'_>) -> Option<Self> {
        let grid = Self::of(events.t)?;
        (!grid.is_readout_beat(events)).then_some(grid)
    }

    /// Whether rows, or single events, are read one per step.
    fn is_readout_beat(self, events: EventSlice<'_>) -> bool {
        let (mut n_together, mut n_of_one_row, mut n_next) = (0_usize, 0_usize, 0_usize);
        for (t, y) in events.t.windows(2).zip(events.y.windows(2)) {
            match ((t[1] - t[0]) as f64 / self.step_us).round() as i64 {
                0 => {
                    n_together += 1;
                    n_of_one_row += usize::from(y[0] == y[1]);
                }
                1 => n_next += 1,
                _ => {}
            }
        }
        let all = events.t.len() as f64;
        if n_together as f64 > MAX_SERIAL_TIE_SHARE * all {
            is_row_readout(n_of_one_row, n_together)
        } else {
            n_next as f64 >= MIN_SERIAL_STEP_SHARE * all
        }
    }

    fn of(stamps: &[i64]) -> Option<Self> {
        if stamps.len() < MIN_STAMPS {
            return None;
        }
        let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
        let middle = stamps[stamps.len() / 2];
        let mut half_us = FIRST_HALF_WIDTH_US;
        let within = |half_us: f64| {
            let from = stamps.partition_point(|t| ((t - middle) as f64) < -half_us);
            let to = stamps.partition_point(|t| ((t - middle) as f64) <= half_us);
            &stamps[from..to]
        };
        while within(half_us).len() < MIN_STAMPS {
            half_us *= 2.0;
            if half_us > MAX_FIRST_HALF_WIDTH_US {
                return None;
            }
        }
        let phases = StampPhases::of(within(half_us), middle);
        let mut hz = phases.lowest([1e6 / STEP_RANGE_US[1], 1e6 / STEP_RANGE_US[0]], half_us)?;
        // Longer stretches determine the step better.
        let all_us = (last - middle).max(middle - first) as f64;
        while half_us < all_us {
            half_us *= 2.0;
            hz = StampPhases::of(within(half_us), middle).best_about(hz, half_us);
        }
        let mean = StampPhases::of(stamps, middle).mean(hz);
        let step_us = 1e6 / hz;
        let zero_us = middle as f64 + mean.angle() / TAU * step_us;
        (mean.length() >= MIN_MEAN_VECTOR_LENGTH).then_some(Self { step_us, zero_us })
    }

    /// The events spread uniformly over their steps, in ascending time. Events of one pixel and
    /// step keep their order and distance.
    #[must_use]
    pub fn spread(self, events: EventSlice<'_>) -> Events {
        let moved = |event: Event| {
            let step = ((event.t as f64 - self.zero_us) / self.step_us).round();
            let pixel = u64::from(event.y) << 16 | u64::from(event.x);
            let share = SplitMix::new(step as i64 as u64, pixel).uniform() - 0.5;
            Event { t: event.t + (share * self.step_us).round() as i64, ..event }
        };
        let mut spread: Events = events.iter().map(moved).collect();
        spread.sort_by_time();
        spread
    }
}

/// Whether pairs with equal stamps are explained by row readout.
pub(crate) fn is_row_readout(n_of_one_row: usize, n_together: usize) -> bool {
    n_of_one_row as f64 >= MIN_SAME_ROW_SHARE * n_together as f64
}

/// Times relative to an instant, seconds.
struct StampPhases(Vec<f64>);

impl StampPhases {
    fn of(stamps: &[i64], middle: i64) -> Self {
        let every = stamps.len().div_ceil(MAX_STAMPS).max(1);
        Self(stamps.iter().step_by(every).map(|t| (t - middle) as f64 * 1e-6).collect())
    }

    /// Mean direction of the phases at a frequency.
    fn mean(&self, hz: f64) -> MeanDirection {
        self.0.iter().map(|t| TAU * hz * t).collect()
    }

    /// The lowest frequency at which the stamps are coherent; multiples are coherent too.
    fn lowest(&self, [from, to]: [f64; 2], half_us: f64) -> Option<f64> {
        let step = Self::resolution(half_us);
        let n = ((to - from) / step) as usize;
        let mut tries = (0..n).map(|i| from + i as f64 * step);
        // Between two trial frequencies some coherence is lost.
        let hz = tries.find(|hz| self.mean(*hz).length() >= 0.95 * MIN_MEAN_VECTOR_LENGTH)?;
        Some(self.best_about(hz, half_us))
    }

    /// The most coherent frequency near one.
    fn best_about(&self, hz: f64, half_us: f64) -> f64 {
        let step = Self::resolution(half_us);
        let tries = (-16..=16).map(|i| hz + 0.25 * f64::from(i) * step);
        let order = |hz: f64| self.mean(hz).length();
        tries.max_by(|a, b| order(*a).total_cmp(&order(*b))).unwrap_or(hz)
    }

    /// Frequency resolution of a stretch.
    fn resolution(half_us: f64) -> f64 {
        0.1 / (half_us * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps of random events, rounded up to a step and scattered by microseconds.
    fn stamps(step_us: f64, scatter_us: f64, seconds: f64) -> Vec<i64> {
        let mut random = SplitMix::new(9, step_us as u64);
        let n = (20_000.0 * seconds) as usize;
        let mut all: Vec<i64> = (0..n)
            .map(|_| {
                let step = (random.uniform() * seconds * 1e6 / step_us).ceil();
                (step * step_us - scatter_us * random.uniform()).round() as i64
            })
            .collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn a_stamp_grid_is_found_and_random_times_have_none() {
        for step_us in [25.0, 250.0, 1e6 / 960.0, 1_000.0, 4_166.7] {
            let grid = StampGrid::of(&stamps(step_us, 0.02 * step_us, 3.0)).unwrap();
            assert!((grid.step_us / step_us - 1.0).abs() < 1e-4, "{step_us}: {grid:?}");
        }
        assert!(StampGrid::of(&stamps(1.0, 0.0, 3.0)).is_none());
        assert!(StampGrid::of(&stamps(500.0, 400.0, 3.0)).is_none(), "a beat that is no grid");
        assert!(StampGrid::of(&stamps(250.0, 5.0, 0.02)).is_none(), "too few");
        let sparse: Vec<i64> = (0..5_000).map(|i| 500_000 * i).collect();
        assert!(StampGrid::of(&sparse).is_none(), "too sparse to be looked at");
    }

    #[test]
    fn a_saturated_readout_is_no_grid() {
        let of = |event: &dyn Fn(i64) -> Event| {
            let events: Events = (0..40_000).map(event).collect();
            assert!(StampGrid::of(events.as_slice().t).is_some(), "its stamps lie on one");
            StampGrid::of_events(events.as_slice()).is_some()
        };
        let at = |step: i64, i: i64, y: i64| Event {
            t: 30 * step,
            x: (i % 40) as u16,
            y: y as u16,
            on: true,
        };
        assert!(of(&|i| at(i / 8, i, i * 7 % 30)), "eight events a step, from anywhere");
        assert!(!of(&|i| at(i / 8, i, i / 8 % 30)), "a row a step");
        assert!(!of(&|i| at(i + i / 5, i, i * 7 % 30)), "an event a step");
    }

    #[test]
    fn spread_events_have_no_grid_and_keep_their_step() {
        let stamps = stamps(250.0, 5.0, 2.0);
        let event = |(i, t): (usize, &i64)| Event { t: *t, x: (i % 40) as u16, y: 3, on: true };
        let events: Events = stamps.iter().enumerate().map(event).collect();
        let grid = StampGrid::of(&stamps).unwrap();
        let spread = grid.spread(events.as_slice());
        assert!(spread.as_slice().first_disorder().is_none());
        assert!(StampGrid::of(spread.as_slice().t).is_none());
        let far = stamps.iter().zip(spread.as_slice().t).map(|(a, b)| (a - b).abs()).max();
        assert!(far <= Some(250), "{far:?}");
    }
}
