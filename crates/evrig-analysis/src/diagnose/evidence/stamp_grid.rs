//! Time stamps on a coarse grid, as from simulators with a fixed time step.
//!
//! A law in continuous time would explain the grid as physics, so events are spread uniformly over
//! their step first.

use crate::coherent_step::CoherentStep;
use evrig_core::event::{Event, EventSlice, Events};
use evrig_core::stats::SplitMix;
use std::f64::consts::TAU;

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
        let CoherentStep { step_us, middle_us, phase } = CoherentStep::of(stamps)?;
        let zero_us = middle_us as f64 + phase.angle() / TAU * step_us;
        Some(Self { step_us, zero_us })
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
