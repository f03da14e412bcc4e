//! A common step of the stamps, as simulators with a fixed time step and slow counters give.

use super::SectionResult;
use super::readout_limits::service;
use crate::coherent_step::CoherentStep;
use evrig_core::event::EventSlice;
use serde::Serialize;

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
        1 => CoherentStep::of(t).map(|found| StampStep {
            step_us: found.step_us,
            is_exact: false,
            coherence: found.phase.length(),
        }),
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
