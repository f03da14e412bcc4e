//! A common step of the stamps, as simulators with a fixed time step and slow counters give.

use super::SectionResult;
use super::readout_limits::service;
use evrig_core::event::EventSlice;
use evrig_core::stats::MeanDirection;
use serde::Serialize;
use std::f64::consts::TAU;

/// Steps that are searched where stamps scatter about a grid or the step is no whole number of
/// microseconds. Below, stamps are fine enough for every effect; above, a frame's period begins.
const STEP_RANGE_US: [f64; 2] = [20.0, 5_000.0];

/// Mean resultant length of the stamps' phases on a grid: a normal scatter of less than 1/12 step.
const MIN_MEAN_VECTOR_LENGTH: f64 = 0.88;

/// Fewest stamps that show a grid, and the most used per stretch, a work budget.
const MIN_STAMPS: usize = 500;
const MAX_STAMPS: usize = 4_000;

/// Half width of the first stretch, doubled until it holds enough stamps. Long stretches need many
/// trial frequencies.
const FIRST_HALF_WIDTH_US: f64 = 20_000.0;
const MAX_FIRST_HALF_WIDTH_US: f64 = 640_000.0;

/// Share of pairs with equal stamps that lie in one row when rows are read one per step.
const MIN_SAME_ROW_SHARE: f64 = 0.9;

/// Fewest distinct stamps: chance gives 20 of them a common divisor of two with probability 1e-6.
const MIN_DISTINCT: usize = 20;

/// The step of a stream's stamps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StampStep {
    /// Microseconds; 1 where there is none but the unit's.
    pub step_us: f64,
    /// Whether all stamps are exact multiples apart. Otherwise they scatter about the steps, or the
    /// step is no whole number of microseconds.
    pub is_exact: bool,
    /// Mean resultant length of the phases within a step: 1 where all agree.
    pub coherence: f64,
}

impl StampStep {
    /// Whether there is a step beyond the resolution of the format.
    #[must_use]
    pub fn is_coarse(&self) -> bool {
        self.step_us > 1.0
    }
}

/// The common step of ascending stamps.
pub(super) fn stamp_step(events: EventSlice<'_>) -> SectionResult<StampStep> {
    let t = events.t;
    let steps = t.windows(2).map(|pair| (pair[1] - pair[0]) as u64).filter(|step| *step > 0);
    let (mut divisor, mut n_distinct) = (0, 1);
    for step in steps {
        divisor = common_divisor(divisor, step);
        n_distinct += 1;
        if divisor == 1 && n_distinct >= MIN_DISTINCT {
            break;
        }
    }
    if n_distinct < MIN_DISTINCT {
        return SectionResult::not_measured(format!(
            "too few distinct stamps for a common step: {n_distinct}, at least {MIN_DISTINCT} are \
             needed"
        ));
    }
    let found = match divisor {
        1 => scattered(t),
        step => Some(StampStep { step_us: step as f64, is_exact: true, coherence: 1.0 }),
    };
    let unit = StampStep { step_us: 1.0, is_exact: true, coherence: 1.0 };
    SectionResult::Known(
        found.filter(|step| !is_readout_beat(events, step.step_us)).unwrap_or(unit),
    )
}

/// Whether the step is that of a busy readout, which reads an event or a row at a time.
fn is_readout_beat(events: EventSlice<'_>, step_us: f64) -> bool {
    let (mut n_together, mut n_of_one_row) = (0.0, 0.0);
    for (t, y) in events.t.windows(2).zip(events.y.windows(2)) {
        if 2.0 * ((t[1] - t[0]) as f64) < step_us {
            n_together += 1.0;
            n_of_one_row += f64::from(u8::from(y[0] == y[1]));
        }
    }
    let is_row_readout = n_together > 0.0 && n_of_one_row >= MIN_SAME_ROW_SHARE * n_together;
    is_row_readout || service(events.t).is_some()
}

fn common_divisor(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// A step about which stamps scatter.
fn scattered(stamps: &[i64]) -> Option<StampStep> {
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
    let phases = SteppedPhases::of(within(half_us), middle);
    let mut hz = phases.lowest([1e6 / STEP_RANGE_US[1], 1e6 / STEP_RANGE_US[0]], half_us)?;
    // Longer stretches determine the step better.
    let all_us = (last - middle).max(middle - first) as f64;
    while half_us < all_us {
        half_us *= 2.0;
        hz = SteppedPhases::of(within(half_us), middle).best_about(hz, half_us);
    }
    let coherence = SteppedPhases::of(stamps, middle).mean(hz).length();
    let step = StampStep { step_us: 1e6 / hz, is_exact: false, coherence };
    (coherence >= MIN_MEAN_VECTOR_LENGTH).then_some(step)
}

/// Times relative to an instant, seconds.
struct SteppedPhases(Vec<f64>);

impl SteppedPhases {
    fn of(stamps: &[i64], middle: i64) -> Self {
        let every = stamps.len().div_ceil(MAX_STAMPS).max(1);
        Self(stamps.iter().step_by(every).map(|t| (t - middle) as f64 * 1e-6).collect())
    }

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
        let length = |hz: f64| self.mean(hz).length();
        tries.max_by(|a, b| length(*a).total_cmp(&length(*b))).unwrap_or(hz)
    }

    /// Distance of trial frequencies for stretches of a half width.
    fn resolution(half_us: f64) -> f64 {
        0.1 / (half_us * 1e-6)
    }
}
