//! The phase of each event in the cycle of the camera's own frames.

use super::SectionResult;
use evrig_core::frame::FrameTiming;
use evrig_core::stats::upper_median;
use evrig_core::time::Davis;
use serde::Serialize;

/// Events are left out that come later than this many periods after the last frame's start: a
/// frame is missing there, or the camera took none.
const MAX_PHASE: f64 = 1.5;

/// What a frame's start is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameReference {
    /// The first row's exposure begins.
    ExposureStart,
    /// The frame's own time stamp.
    FrameStamp,
    /// No frame is in the file: whole periods of a cycle that the events show.
    FoundPeriod,
}

/// When the camera took frames, on the clock of the events.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameStarts {
    /// Start of each frame, µs, ascending.
    pub starts_us: Vec<i64>,
    /// What a start is.
    pub reference: FrameReference,
}

impl FrameStarts {
    /// Starts in ascending order without repetitions.
    #[must_use]
    pub fn new(mut starts_us: Vec<i64>, reference: FrameReference) -> Self {
        starts_us.sort_unstable();
        starts_us.dedup();
        Self { starts_us, reference }
    }

    /// Starts of the exposures where all frames state them, else the frames' stamps; `None` without
    /// frames.
    #[must_use]
    pub fn of_frames(frames: &[FrameTiming<Davis>]) -> Option<Self> {
        let exposures: Option<Vec<i64>> =
            frames.iter().map(|frame| Some(frame.exposure?[0].as_micros())).collect();
        let starts = match exposures {
            Some(starts) => Self::new(starts, FrameReference::ExposureStart),
            None => {
                let stamps = frames.iter().map(|frame| frame.stamp.as_micros());
                Self::new(stamps.collect(), FrameReference::FrameStamp)
            }
        };
        (!starts.starts_us.is_empty()).then_some(starts)
    }

    /// The frames whose cycle overlaps the events' time.
    pub(super) fn during(&self, t: &[i64]) -> Self {
        let period = self.period_us().unwrap_or(0.0) as i64;
        let [first, last] = [t.first(), t.last()].map(|t| t.copied().unwrap_or(0));
        let overlap = |start: &&i64| **start > first.saturating_sub(period) && **start <= last;
        let starts_us = self.starts_us.iter().filter(overlap).copied().collect();
        Self { starts_us, reference: self.reference }
    }

    /// The median time between frames; `None` for fewer than two frames.
    #[must_use]
    pub fn period_us(&self) -> Option<f64> {
        let pairs = self.starts_us.windows(2);
        upper_median(&mut pairs.map(|pair| (pair[1] - pair[0]) as f64).collect::<Vec<_>>())
    }
}

/// Frame starts with the period by which phases wrap.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameFold<'a> {
    pub(super) starts: &'a [i64],
    pub(super) period_us: f64,
    pub(super) reference: FrameReference,
}

impl<'a> FrameFold<'a> {
    pub(super) fn new(frames: &'a FrameStarts, min_frames: usize) -> SectionResult<Self> {
        let n = frames.starts_us.len();
        match frames.period_us() {
            Some(period_us) if n >= min_frames && period_us > 0.0 => {
                let FrameStarts { starts_us: starts, reference } = frames;
                SectionResult::Known(Self { starts, period_us, reference: *reference })
            }
            _ => SectionResult::not_measured(format!(
                "too few frames to find events that follow them: {n}, at least {min_frames} are \
                 needed"
            )),
        }
    }

    /// Visits the events within a frame's cycle: index, frame, and time since its start, µs.
    pub(super) fn visit(&self, t: &[i64], mut visit: impl FnMut(usize, usize, f64)) {
        let mut frame = 0;
        let Some(&first) = self.starts.first() else { return };
        let max_us = MAX_PHASE * self.period_us;
        for (i, &t) in t.iter().enumerate().skip(t.partition_point(|t| *t < first)) {
            while self.starts.get(frame + 1).is_some_and(|start| *start <= t) {
                frame += 1;
            }
            let since = (t - self.starts[frame]) as f64;
            if since < max_us {
                visit(i, frame, since);
            }
        }
    }

    /// A time difference wrapped into half a period to either side.
    pub(super) fn wrap(&self, us: f64) -> f64 {
        // Adding and subtracting 1.5 * 2^52 rounds a small double to a whole number; `round` is a
        // function call where the processor's rounding instruction is not presupposed.
        const ROUNDING: f64 = 6_755_399_441_055_744.0;
        us - self.period_us * ((us / self.period_us + ROUNDING) - ROUNDING)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_before_the_first_frame_and_after_a_missing_one_have_no_phase() {
        let starts = FrameStarts::new(vec![500, 100, 200, 300], FrameReference::FrameStamp);
        let SectionResult::Known(fold) = FrameFold::new(&starts, 2) else { panic!("four frames") };
        assert_eq!(fold.period_us, 100.0);
        let mut seen = Vec::new();
        fold.visit(&[50, 100, 199, 310, 460, 510], |i, frame, us| seen.push((i, frame, us)));
        assert_eq!(seen, [(1, 0, 0.0), (2, 0, 99.0), (3, 2, 10.0), (5, 3, 10.0)]);
        assert!((fold.wrap(95.0) + 5.0).abs() < 1e-9);
    }
}
