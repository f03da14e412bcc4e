//! Phase locking of events to the frame rate.

use evrig_core::event::EventSlice;
use evrig_core::stats::MeanDirection;

/// Vector strength of the phases of events in their frame intervals.
///
/// The strength is the length of the mean of exp(2 pi i phase), the phase running from 0 at one
/// frame to 1 at the next (Goldberg and Brown, J. Neurophysiol. 32, 1969): 0 for a uniform phase, 1
/// when all events have one phase. By chance alone, n independent events have about 0.9 / sqrt(n).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PhaseLocking(MeanDirection);

impl PhaseLocking {
    /// Adds the events of one frame interval, which begins at `start_us` and lasts `span_us`.
    pub fn add(&mut self, events: EventSlice<'_>, start_us: i64, span_us: i64) {
        let per_us = std::f64::consts::TAU / span_us.max(1) as f64;
        for &t in events.t {
            self.0.add((t - start_us) as f64 * per_us);
        }
    }

    /// Adds ascending events between frames at ascending times, µs; those outside are left out.
    pub fn add_between(&mut self, events: EventSlice<'_>, frames_us: &[i64]) {
        for pair in frames_us.windows(2) {
            // An event at a frame's time belongs to the interval before it.
            let mine = events.between(pair[0] + 1, pair[1] + 1);
            self.add(mine, pair[0], pair[1] - pair[0]);
        }
    }

    /// Its strength, 0 to 1; `NaN` without events.
    #[must_use]
    pub fn strength(&self) -> f64 {
        self.0.length()
    }

    /// Events that were added.
    #[must_use]
    pub const fn n_events(&self) -> u64 {
        self.0.n()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};

    #[test]
    fn events_at_one_phase_beat_and_even_ones_do_not() {
        let at = |phase: fn(i64) -> i64| -> Events {
            (0..4_000)
                .map(|i| Event { t: 1_000 * (i / 10) + phase(i), x: 0, y: 0, on: true })
                .collect()
        };
        let frames: Vec<i64> = (0..=400).map(|i| 1_000 * i).collect();
        let strength = |events: &Events| {
            let mut rhythm = PhaseLocking::default();
            rhythm.add_between(events.as_slice(), &frames);
            (rhythm.strength(), rhythm.n_events())
        };
        assert!((strength(&at(|_| 250)).0 - 1.0).abs() < 1e-9);
        let (even, n) = strength(&at(|i| 1 + 100 * (i % 10)));
        assert!(even < 1e-9 && n == 4_000, "{even}");
        assert!(PhaseLocking::default().strength().is_nan());
    }
}
