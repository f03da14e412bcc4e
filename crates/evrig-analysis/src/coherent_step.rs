//! A step about which time stamps scatter, or that is no whole number of microseconds.

use evrig_core::stats::MeanDirection;
use std::f64::consts::TAU;

/// Steps that are searched. Below, stamps are fine enough for every effect; above, a frame's period
/// begins.
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

/// A step at which the phases of stamps agree.
pub(crate) struct CoherentStep {
    /// Microseconds.
    pub(crate) step_us: f64,
    /// A stamp to which the phases refer.
    pub(crate) middle_us: i64,
    /// Mean direction of the phases.
    pub(crate) phase: MeanDirection,
}

impl CoherentStep {
    /// The step of ascending stamps.
    pub(crate) fn of(stamps: &[i64]) -> Option<Self> {
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
        let phase = StampPhases::of(stamps, middle).mean(hz);
        let step = Self { step_us: 1e6 / hz, middle_us: middle, phase };
        (step.phase.length() >= MIN_MEAN_VECTOR_LENGTH).then_some(step)
    }
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
