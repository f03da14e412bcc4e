//! Poses at a steady rate, and how well they are known in time.

use crate::{Arm, Progress, host_clock};
use crate::{DeviceError, PoseReading};
use evrig_core::time::{HostMonotonic, Span, Stamp};
use evrig_core::units::Hertz;
use serde::Serialize;
use std::time::Duration;

/// A steady beat. A beat that was missed is left out, not made up for, so that what follows a
/// delay is not crowded.
#[derive(Debug, Clone, Copy)]
pub struct PoseTimer {
    period: Span,
    next: Option<Stamp<HostMonotonic>>,
}

impl PoseTimer {
    /// A beat of the given rate; rates below one per hour or above 1 kHz are taken as those.
    #[must_use]
    pub fn new(rate: Hertz) -> Self {
        let rate = rate.value().clamp(1.0 / 3600.0, 1000.0);
        Self { period: Span::from_secs_f64(1.0 / rate), next: None }
    }

    /// How long it is from `now` to the next beat; the first is at once.
    pub fn until_next(&mut self, now: Stamp<HostMonotonic>) -> Span {
        let due = self.next.unwrap_or(now);
        let late = (now - due).as_nanos().max(0);
        let n_missed = late / self.period.as_nanos().max(1);
        let skipped = Span::from_nanos(self.period.as_nanos().saturating_mul(n_missed));
        let due = due + skipped;
        self.next = Some(due + self.period);
        Span::from_nanos((due - now).as_nanos().max(0))
    }
}

/// Reads the arm's progress in step with `pace` until the started steps have ended, and passes each
/// reading to `seen`; goes on while that returns true, and aborts the arm otherwise.
/// True when the steps ended, false when they were broken off.
///
/// # Errors
/// Those of [`Arm::progress`]; the arm is then stopped.
pub fn drive_to_end(
    arm: &mut dyn Arm,
    pace: &mut PoseTimer,
    seen: &mut dyn FnMut(&Progress) -> bool,
) -> Result<bool, DeviceError> {
    loop {
        let rest = pace.until_next(host_clock::now());
        std::thread::sleep(Duration::from_nanos(rest.as_nanos().unsigned_abs()));
        let progress = arm.progress()?;
        if !seen(&progress) {
            arm.abort()?;
            return Ok(false);
        }
        if progress.is_done {
            return Ok(true);
        }
    }
}

/// The timing of a series of poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseTiming {
    /// Number of poses.
    pub n_poses: usize,
    /// Poses per second from the first to the last; zero for fewer than two.
    pub rate_hz: f64,
    /// The longest time without a pose, ns.
    pub largest_gap: Span,
    /// The middle one of the poses' time uncertainties, ns.
    pub median_uncertainty: Span,
    /// The largest of them, ns.
    pub largest_uncertainty: Span,
}

impl PoseTiming {
    /// Of poses in the order in which they were taken; `None` when there are none.
    #[must_use]
    pub fn of(poses: &[PoseReading]) -> Option<Self> {
        let (first, last) = (poses.first()?, poses.last()?);
        let mut uncertainties: Vec<Span> = poses.iter().map(PoseReading::uncertainty).collect();
        uncertainties.sort_unstable();
        let gaps = poses.windows(2).map(|pair| pair[1].time() - pair[0].time());
        let duration_s = (last.time() - first.time()).as_secs_f64();
        let n_gaps = poses.len() - 1;
        Some(Self {
            n_poses: poses.len(),
            rate_hz: if duration_s > 0.0 { n_gaps as f64 / duration_s } else { 0.0 },
            largest_gap: gaps.max().unwrap_or(Span::ZERO),
            median_uncertainty: uncertainties[uncertainties.len() / 2],
            largest_uncertainty: uncertainties[uncertainties.len() - 1],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_session::rig::{Joints, Pose};

    fn at(ms: i64) -> Stamp<HostMonotonic> {
        Stamp::from_micros(ms * 1_000)
    }

    #[test]
    fn the_beat_is_steady_and_missed_beats_are_left_out() {
        let mut pace = PoseTimer::new(Hertz(20.0));
        assert_eq!(pace.until_next(at(1_000)), Span::ZERO);
        assert_eq!(pace.until_next(at(1_010)), Span::from_micros(40_000));
        // The look at 1050 took until 1080: the beat at 1100 is kept.
        assert_eq!(pace.until_next(at(1_080)), Span::from_micros(20_000));
        // A delay of 330 ms: at once, then on the old grid again.
        assert_eq!(pace.until_next(at(1_480)), Span::ZERO);
        assert_eq!(pace.until_next(at(1_481)), Span::from_micros(19_000));
    }

    #[test]
    fn the_timing_of_poses_is_computed_from_their_exchanges() {
        let pose = |asked, answered| PoseReading {
            pose: Pose::default(),
            joints: Joints::default(),
            asked: at(asked),
            answered: at(answered),
        };
        let timing = PoseTiming::of(&[pose(0, 4), pose(50, 54), pose(150, 160)]).unwrap();
        assert_eq!(timing.n_poses, 3);
        assert_eq!(timing.largest_gap, Span::from_micros(103_000));
        assert!((timing.rate_hz - 2.0 / 0.153).abs() < 1e-9);
        assert_eq!(timing.median_uncertainty, Span::from_nanos(2_000_001));
        assert_eq!(timing.largest_uncertainty, Span::from_nanos(5_000_001));
        assert_eq!(PoseTiming::of(&[]), None);
    }
}
