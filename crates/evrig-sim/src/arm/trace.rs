//! The true trajectory of the tool.

use evrig_core::time::Span;
use evrig_session::rig::Pose;
use std::sync::{PoisonError, RwLock};

/// The trajectory of a tool on the arm's clock, as far as it is known.
#[derive(Debug, Default)]
pub struct ToolTrace {
    /// In order of time; straight lines between.
    points: RwLock<Vec<(Span, [f64; 4])>>,
}

impl ToolTrace {
    /// Notes where the tool is; a time that is not later than all before is known already.
    pub(super) fn note(&self, at: Span, xyzr: [f64; 4]) {
        let mut points = self.points.write().unwrap_or_else(PoisonError::into_inner);
        let n = points.len();
        if points.last().is_some_and(|(last, _)| *last >= at) {
            return;
        }
        let rests = n >= 2 && points[n - 1].1 == xyzr && points[n - 2].1 == xyzr;
        match points.last_mut() {
            // A rest needs its two ends only, however long it is.
            Some(last) if rests => last.0 = at,
            _ => points.push((at, xyzr)),
        }
    }

    /// Time up to which the trajectory is known.
    #[must_use]
    pub fn known_until(&self) -> Span {
        let points = self.points.read().unwrap_or_else(PoisonError::into_inner);
        points.last().map_or(Span::ZERO, |(at, _)| *at)
    }

    /// Pose of the tool; constant before the first known instant and after the last.
    #[must_use]
    pub fn pose_at(&self, time: Span) -> Pose {
        let points = self.points.read().unwrap_or_else(PoisonError::into_inner);
        let after = points.partition_point(|(at, _)| *at <= time);
        let before = after.checked_sub(1).and_then(|index| points.get(index));
        match (before, points.get(after)) {
            (Some((t0, from)), Some((t1, to))) => {
                let part = (time - *t0).as_secs_f64() / (*t1 - *t0).as_secs_f64();
                Pose::from_mm_deg(std::array::from_fn(|i| from[i] + (to[i] - from[i]) * part))
            }
            (Some((_, xyzr)), None) | (None, Some((_, xyzr))) => Pose::from_mm_deg(*xyzr),
            (None, None) => Pose::from_mm_deg([0.0; 4]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_straight_between_its_points_and_a_rest_costs_two() {
        let trace = ToolTrace::default();
        let ms = |n: i64| Span::from_micros(n * 1_000);
        for n in 0..1_000 {
            trace.note(ms(n), [1.0, 0.0, 0.0, 90.0]);
        }
        trace.note(ms(1_000), [2.0, 0.0, 0.0, 90.0]);
        assert_eq!(trace.points.read().unwrap().len(), 3);
        assert_eq!(trace.known_until(), ms(1_000));
        let x = |at: Span| trace.pose_at(at).position_mm()[0];
        assert_eq!([x(ms(-5)), x(ms(500)), x(ms(2_000))], [1.0, 1.0, 2.0]);
        assert!((x(Span::from_micros(999_500)) - 1.5).abs() < 1e-9);
    }
}
