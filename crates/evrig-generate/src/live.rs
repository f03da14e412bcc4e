//! Generation while frames arrive, with bounded latency and counts of what was left out.
//!
//! The caller passes the time; no clock is read here, so the same arrivals give the same events.

use crate::generator::{GenerateError, Generator};
use crate::interpolate::Interpolator;
use crate::rows::{RowShift, RowTimes};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use serde::Serialize;

/// Counts of the frames by outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct LiveCounts {
    /// Frames that arrived; `seen = taken + late + refused`.
    pub n_seen: u64,
    /// Frames that events were made of.
    pub n_taken: u64,
    /// Frames left out because they arrived too late; the interval to the next is longer.
    pub n_late: u64,
    /// Frames that no generator can take: not later than the one before, of another size.
    pub n_refused: u64,
    /// Events made.
    pub n_events: u64,
    /// Longest time from a taken frame to its events, µs, as the caller's clock has it.
    pub worst_latency_us: i64,
}

/// Outcome of one frame.
#[derive(Debug)]
pub enum FrameOutcome {
    /// Events were made up to its time.
    Taken,
    /// It arrived too late and was left out.
    Late,
    /// It was refused by the generator.
    Refused(GenerateError),
}

/// A generator with bounded latency.
pub struct LiveGenerator {
    generator: Box<dyn Generator>,
    interpolator: Option<Interpolator>,
    bound_us: i64,
    rows: RowTimes,
    shift: RowShift,
    made: Events,
    tally: LiveCounts,
}

impl LiveGenerator {
    /// Frames older than `bound_us` on arrival are left out, so the generator works on the newest.
    /// Events are shifted to the times of their `rows`; those that a row of the next frame may
    /// precede are held back until then.
    #[must_use]
    pub fn new(
        generator: Box<dyn Generator>,
        interpolator: Option<Interpolator>,
        bound_us: i64,
        rows: RowTimes,
    ) -> Self {
        Self {
            generator,
            interpolator,
            bound_us,
            rows,
            shift: RowShift::default(),
            made: Events::new(),
            tally: LiveCounts::default(),
        }
    }

    /// Takes in a frame and appends the events since the last taken one to `out`. `now_us` gives
    /// the time on the frames' clock; it is called before and after.
    pub fn push(
        &mut self,
        frame: Luminance,
        now_us: &mut dyn FnMut() -> i64,
        out: &mut Events,
    ) -> FrameOutcome {
        self.tally.n_seen += 1;
        let taken_us = frame.t_us;
        if now_us().saturating_sub(taken_us) > self.bound_us {
            self.tally.n_late += 1;
            return FrameOutcome::Late;
        }
        let size = frame.size;
        let Self { generator, made, .. } = self;
        made.clear();
        let pushed = match &mut self.interpolator {
            Some(interpolator) => interpolator.push(frame, |frame| generator.push(frame, made)),
            None => generator.push(&frame, made),
        };
        self.tally.n_events += made.len() as u64;
        self.shift.push(self.rows, size, taken_us, made, out);
        if let Err(error) = pushed {
            self.tally.n_refused += 1;
            return FrameOutcome::Refused(error);
        }
        self.tally.n_taken += 1;
        let latency_us = now_us().saturating_sub(taken_us);
        self.tally.worst_latency_us = self.tally.worst_latency_us.max(latency_us);
        FrameOutcome::Taken
    }

    /// Appends the events that are still held back.
    pub fn finish(&mut self, out: &mut Events) {
        self.shift.finish(out);
    }

    /// Counts so far.
    #[must_use]
    pub const fn tally(&self) -> LiveCounts {
        self.tally
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GenerateParameters, Preset, build};
    use evrig_core::event::Event;
    use evrig_core::geometry::Size;

    fn frame(t_us: i64) -> Luminance {
        let size = Size::new(20, 10);
        let values =
            (0..200).map(|i| 100.0 + 60.0 * (i as f32 + t_us as f32 * 1e-4).sin()).collect();
        Luminance { t_us, size, values }
    }

    fn live(bound_us: i64) -> LiveGenerator {
        let generator = build(&GenerateParameters::from_preset(Preset::Dvs346, 1), None).unwrap();
        LiveGenerator::new(generator, None, bound_us, RowTimes::default())
    }

    #[test]
    fn late_frames_are_left_out_and_counted_and_the_others_make_events_in_order() {
        let mut live = live(20_000);
        let mut out = Events::new();
        // The host stalls for three frames of eight milliseconds, then catches up.
        let delays = [5_000, 5_000, 30_000, 24_000, 16_000, 8_000, 5_000, 5_000];
        for (i, delay) in delays.into_iter().enumerate() {
            let t_us = i as i64 * 8_333;
            let fate = live.push(frame(t_us), &mut || t_us + delay, &mut out);
            assert_eq!(matches!(fate, FrameOutcome::Late), delay > 20_000, "{fate:?}");
        }
        let tally = live.tally();
        assert_eq!((tally.n_seen, tally.n_taken, tally.n_late, tally.n_refused), (8, 6, 2, 0));
        assert_eq!((tally.n_events, tally.worst_latency_us), (out.len() as u64, 16_000));
        assert!(out.len() > 100 && out.as_slice().first_disorder().is_none());
    }

    #[test]
    fn events_come_at_their_rows_times_and_none_is_lost() {
        let made = |row_us: f64| {
            let parameters = GenerateParameters::from_preset(Preset::Dvs346, 1);
            let generator = build(&parameters, None).unwrap();
            let rows = RowTimes { row_us, at_row: 0.0 };
            let mut live = LiveGenerator::new(generator, None, i64::MAX, rows);
            let mut out = Events::new();
            for i in 0..12 {
                let _ = live.push(frame(i * 8_333), &mut || 0, &mut out);
            }
            live.finish(&mut out);
            assert_eq!(live.tally().n_events, out.len() as u64);
            out
        };
        let (plain, rolling) = (made(0.0), made(400.0));
        assert_eq!(rolling.as_slice().first_disorder(), None);
        let mut moved: Events =
            plain.as_slice().iter().map(|e| Event { t: e.t + 400 * i64::from(e.y), ..e }).collect();
        moved.sort_by_time();
        let sorted = |events: &Events| {
            let mut all: Vec<_> = events.as_slice().iter().map(|e| (e.t, e.y, e.x, e.on)).collect();
            all.sort_unstable();
            all
        };
        assert!(sorted(&rolling) == sorted(&moved) && rolling.len() > 100);
    }

    #[test]
    fn a_frame_that_cannot_be_used_is_counted_with_its_reason() {
        let mut live = live(i64::MAX);
        let mut out = Events::new();
        let _ = live.push(frame(5_000), &mut || 0, &mut out);
        let fate = live.push(frame(5_000), &mut || 0, &mut out);
        assert!(matches!(fate, FrameOutcome::Refused(GenerateError::TimeNotAscending { .. })));
        assert!(matches!(live.push(frame(9_000), &mut || 0, &mut out), FrameOutcome::Taken));
        assert_eq!((live.tally().n_refused, live.tally().n_taken), (1, 2));
    }
}
