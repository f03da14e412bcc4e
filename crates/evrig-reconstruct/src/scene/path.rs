//! Path of the camera head over the target.

use super::head::{HeadPose, POSE_DOF};
use evrig_core::stats::upper_median;
use evrig_core::time::{PiSensor, Span, Stamp};
use serde::{Deserialize, Serialize};

/// Least change of the log level between two frames that counts as a jump: below any event
/// threshold.
const MIN_JUMP: f64 = 0.05;
/// A jump exceeds the median change between frames by this factor, so that mains flicker is no
/// jump.
const JUMP_FACTOR: f64 = 8.0;
/// Standard deviation of the Gaussian that smooths the illumination level, seconds. Frames alias
/// mains flicker (100 Hz appears as 20 Hz at 120 frames per second); changes slower than about 5 Hz
/// remain.
const LEVEL_SIGMA_S: f64 = 0.02;

/// Path from the Pi's frames, with one knot per frame.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadPath {
    /// Origin of the knots' times.
    pub zero: Stamp<PiSensor>,
    /// In ascending time.
    pub knots: Vec<PathKnot>,
    /// Longest gap between knots that is interpolated.
    pub max_gap: Span,
    /// Derivative of the pose at each knot, per second.
    slopes: Vec<HeadPose>,
    /// Smoothed log illumination level at each knot.
    levels: Vec<f64>,
}

/// Pose of the head at one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PathKnot {
    /// Mid-exposure of the frame's middle row, seconds from the path's zero.
    pub time_s: f64,
    /// Position of the Pi camera along the head's axes and distance from the target, millimetres;
    /// wrist rotation, radians.
    pub pose: [f64; POSE_DOF],
    /// Standard errors of the pose.
    pub pose_error: [f64; POSE_DOF],
    /// Logarithm of the frame's brightness over the map's.
    pub ln_gain: f64,
    /// Root-mean-square residual against the map, over the frame's own noise.
    pub misfit: f64,
}

struct KnotInterval {
    left: usize,
    length_s: f64,
    /// From 0 at the left knot to 1 at the right.
    part: f64,
}

impl HeadPath {
    /// The path through knots in ascending time.
    #[must_use]
    pub fn new(zero: Stamp<PiSensor>, knots: Vec<PathKnot>, max_gap: Span) -> Self {
        let slopes = slopes(&knots, max_gap.as_secs_f64());
        let levels = knots.iter().map(|knot| knot.ln_gain).collect();
        let mut path = Self { zero, knots, max_gap, slopes, levels };
        path.smooth_levels();
        path
    }

    /// First and last time, seconds from the path's zero.
    #[must_use]
    pub fn span_s(&self) -> Option<[f64; 2]> {
        Some([self.knots.first()?.time_s, self.knots.last()?.time_s])
    }

    /// Standard error of a common time shift: position error over speed, both root mean squares.
    /// None where nothing moves.
    pub(super) fn time_error_s(&self) -> Option<f64> {
        let square = |of: [f64; 2]| of[0].powi(2) + of[1].powi(2);
        let errors: f64 =
            self.knots.iter().map(|k| square([k.pose_error[0], k.pose_error[1]])).sum();
        let ways: f64 = self.slopes.iter().map(|slope| square([slope[0], slope[1]])).sum();
        (ways > 0.0).then(|| (errors / 2.0 / ways).sqrt())
    }

    /// Standard error of position along one axis, millimetres, root mean square over the knots.
    pub(super) fn place_error_mm(&self) -> f64 {
        let square = |k: &PathKnot| (k.pose_error[0].powi(2) + k.pose_error[1].powi(2)) / 2.0;
        (self.knots.iter().map(square).sum::<f64>() / self.knots.len().max(1) as f64).sqrt()
    }

    fn interval(&self, time_s: f64) -> Option<KnotInterval> {
        let after = self.knots.partition_point(|knot| knot.time_s <= time_s);
        let left = after.checked_sub(1)?.min(self.knots.len().checked_sub(2)?);
        let (from, to) = (self.knots[left].time_s, self.knots[left + 1].time_s);
        let length_s = to - from;
        let is_known = time_s <= to && length_s <= self.max_gap.as_secs_f64();
        is_known.then(|| KnotInterval { left, length_s, part: (time_s - from) / length_s })
    }

    /// Pose at a time; None outside the path and in a gap.
    pub(super) fn pose(&self, time_s: f64) -> Option<HeadPose> {
        let KnotInterval { left, length_s, part: s } = self.interval(time_s)?;
        let (a, b) = (&self.knots[left].pose, &self.knots[left + 1].pose);
        let (m, n) = (&self.slopes[left], &self.slopes[left + 1]);
        let (s2, s3) = (s * s, s * s * s);
        let blend = [2.0 * s3 - 3.0 * s2 + 1.0, s3 - 2.0 * s2 + s, s3 - s2];
        let at = |i: usize| {
            blend[0] * a[i]
                + (1.0 - blend[0]) * b[i]
                + length_s * (blend[1] * m[i] + blend[2] * n[i])
        };
        Some(std::array::from_fn(at))
    }

    /// Derivative of the pose per second; zero where unknown.
    pub(super) fn speed(&self, time_s: f64) -> HeadPose {
        let step = 1e-4;
        let side = |by: f64| self.pose(time_s + by);
        match (side(-step), self.pose(time_s), side(step)) {
            (Some(a), _, Some(b)) => std::array::from_fn(|i| (b[i] - a[i]) / (2.0 * step)),
            (None, Some(a), Some(b)) | (Some(a), Some(b), None) => {
                std::array::from_fn(|i| (b[i] - a[i]) / step)
            }
            _ => [0.0; POSE_DOF],
        }
    }

    /// Intervals with a jump of the illumination level, seconds, ascending and disjoint. A frame
    /// may have integrated part of a jump, so the neighbouring intervals are included.
    pub(super) fn jumps_s(&self) -> Vec<[f64; 2]> {
        let steps: Vec<f64> =
            self.knots.windows(2).map(|pair| (pair[1].ln_gain - pair[0].ln_gain).abs()).collect();
        let Some(common) = upper_median(&mut steps.clone()) else { return Vec::new() };
        let least = MIN_JUMP.max(JUMP_FACTOR * common);
        let last = self.knots.len() - 1;
        let mut all: Vec<[f64; 2]> = Vec::new();
        for at in (0..steps.len()).filter(|&at| steps[at] > least) {
            let [from, to] =
                [at.saturating_sub(1), (at + 2).min(last)].map(|k| self.knots[k].time_s);
            match all.last_mut().filter(|before| from <= before[1]) {
                Some(before) => before[1] = to,
                None => all.push([from, to]),
            }
        }
        all
    }

    /// Log illumination level relative to the map, linear between knots.
    pub(super) fn ln_light(&self, time_s: f64) -> f64 {
        let Some(KnotInterval { left, part, .. }) = self.interval(time_s) else { return f64::NAN };
        let (a, b) = (self.levels[left], self.levels[left + 1]);
        a + (b - a) * part
    }

    /// Local linear smoothing between jumps and gaps; local lines have no boundary bias.
    fn smooth_levels(&mut self) {
        let jumps = self.jumps_s();
        let is_separate = |a: f64, b: f64| {
            b - a > self.max_gap.as_secs_f64()
                || jumps.iter().any(|[from, to]| a < *to && *from < b)
        };
        let mut begin = 0;
        for end in 1..=self.knots.len() {
            let goes_on = end < self.knots.len()
                && !is_separate(self.knots[end - 1].time_s, self.knots[end].time_s);
            if !goes_on {
                let smooth: Vec<f64> = (begin..end)
                    .map(|at| local_line(&self.knots[begin..end], at - begin))
                    .collect();
                self.levels[begin..end].copy_from_slice(&smooth);
                begin = end;
            }
        }
    }
}

/// Gaussian-weighted line through the neighbours, evaluated at knot `at`.
fn local_line(knots: &[PathKnot], at: usize) -> f64 {
    let now = knots[at].time_s;
    let reach = 4.0 * LEVEL_SIGMA_S;
    let first = knots.partition_point(|knot| knot.time_s < now - reach);
    let (mut n, mut t, mut tt, mut y, mut ty) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for knot in knots[first..].iter().take_while(|knot| knot.time_s <= now + reach) {
        let by = (knot.time_s - now) / LEVEL_SIGMA_S;
        let weight = (-0.5 * by * by).exp();
        n += weight;
        t += weight * by;
        tt += weight * by * by;
        y += weight * knot.ln_gain;
        ty += weight * by * knot.ln_gain;
    }
    let spread = n * tt - t * t;
    if spread > 1e-9 * n * n { (tt * y - t * ty) / spread } else { y / n }
}

/// Slopes of natural cubic splines through each run of knots without a gap.
fn slopes(knots: &[PathKnot], max_gap_s: f64) -> Vec<HeadPose> {
    let mut all = vec![[0.0; POSE_DOF]; knots.len()];
    let mut begin = 0;
    for end in 1..=knots.len() {
        let cut = end == knots.len() || knots[end].time_s - knots[end - 1].time_s > max_gap_s;
        if cut {
            natural_spline_slopes(&knots[begin..end], &mut all[begin..end]);
            begin = end;
        }
    }
    all
}

/// Natural cubic spline slopes by the Thomas algorithm.
fn natural_spline_slopes(knots: &[PathKnot], slopes: &mut [HeadPose]) {
    let n = knots.len();
    if n < 2 {
        return;
    }
    let over = |i: usize| 1.0 / (knots[i + 1].time_s - knots[i].time_s);
    let rise = |i: usize, axis: usize| {
        3.0 * (knots[i + 1].pose[axis] - knots[i].pose[axis]) * over(i) * over(i)
    };
    // `upper` is the remaining upper band.
    let mut upper = vec![0.0; n];
    for i in 0..n {
        let left = if i > 0 { over(i - 1) } else { 0.0 };
        let right = if i + 1 < n { over(i) } else { 0.0 };
        let before = if i > 0 { upper[i - 1] } else { 0.0 };
        let pivot = 2.0 * (left + right) - left * before;
        upper[i] = right / pivot;
        let last = if i > 0 { slopes[i - 1] } else { [0.0; POSE_DOF] };
        slopes[i] = std::array::from_fn(|axis| {
            let behind = if i > 0 { rise(i - 1, axis) - left * last[axis] } else { 0.0 };
            let ahead = if i + 1 < n { rise(i, axis) } else { 0.0 };
            (behind + ahead) / pivot
        });
    }
    for i in (0..n - 1).rev() {
        let next = slopes[i + 1];
        slopes[i].iter_mut().zip(next).for_each(|(slope, next)| *slope -= upper[i] * next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knot(time_s: f64) -> PathKnot {
        let pose = [20.0 * (3.0 * time_s).sin(), 5.0 * time_s, 225.0, 0.1 * (2.0 * time_s).cos()];
        PathKnot { time_s, pose, pose_error: [0.0; POSE_DOF], ln_gain: time_s, misfit: 1.0 }
    }

    fn path(times: impl Iterator<Item = f64>) -> HeadPath {
        let knots = times.map(knot).collect();
        HeadPath::new(Stamp::from_nanos(0), knots, Span::from_micros(50_000))
    }

    #[test]
    fn a_swing_is_met_between_the_frames_even_where_one_is_missing() {
        let all = path((0..240).filter(|i| *i != 100).map(|i| f64::from(i) / 120.0));
        for i in 30..1_900 {
            let time_s = f64::from(i) * 1e-3;
            let (got, truth) = (all.pose(time_s).unwrap(), knot(time_s).pose);
            for axis in 0..POSE_DOF {
                assert!(
                    (got[axis] - truth[axis]).abs() < 2e-6 + 2e-5 * f64::from(u8::from(axis == 0))
                );
            }
            let speed = all.speed(time_s);
            assert!((speed[0] - 60.0 * (3.0 * time_s).cos()).abs() < 0.02, "{speed:?}");
        }
    }

    #[test]
    fn across_a_gap_and_outside_no_path_leads() {
        let all = path((0..40).filter(|i| !(10..20).contains(i)).map(|i| f64::from(i) / 120.0));
        assert!(all.pose(-1e-6).is_none() && all.pose(0.3251).is_none());
        assert!(all.pose(12.0 / 120.0).is_none());
        assert!(all.pose(0.0).is_some() && all.pose(0.325).is_some());
        assert!(all.ln_light(0.1).is_nan());
        assert!((all.ln_light(0.03) - 0.03).abs() < 1e-12);
    }

    #[test]
    fn light_that_frames_cannot_follow_is_smoothed_away_and_the_rest_is_not() {
        let zero = Stamp::from_nanos(0);
        let of = |level: &dyn Fn(f64) -> f64| {
            let at = |i: i32| f64::from(i) / 120.0;
            let knots = (0..240).map(|i| PathKnot { ln_gain: level(at(i)), ..knot(at(i)) });
            HeadPath::new(zero, knots.collect(), Span::from_micros(50_000))
        };
        let swing = |path: &HeadPath| {
            let at = (60..180).map(|i| path.ln_light(f64::from(i) / 120.0).abs());
            at.fold(0.0, f64::max)
        };
        let mains = |hz: f64| move |t: f64| 0.1 * (std::f64::consts::TAU * hz * t).sin();
        assert!(swing(&of(&mains(100.0))) < 0.006);
        assert!(swing(&of(&mains(2.0))) > 0.095);
        // A flash keeps its edge.
        let flash = of(&|t| if t > 1.0 { 0.3 } else { 0.0 });
        assert!(flash.ln_light(0.97).abs() < 1e-9 && (flash.ln_light(1.03) - 0.3).abs() < 1e-9);
    }

    #[test]
    fn a_flash_is_a_jump_at_either_end_and_flicker_is_none() {
        let knot_at = |i: u32, ln_gain: f64| PathKnot { ln_gain, ..knot(f64::from(i) / 100.0) };
        let zero = Stamp::from_nanos(0);
        let flash = |i: u32| if (40..50).contains(&i) { 0.25 } else { 0.001 * f64::from(i % 3) };
        let knots = (0..100).map(|i| knot_at(i, flash(i))).collect();
        let jumps = HeadPath::new(zero, knots, Span::from_micros(50_000)).jumps_s();
        assert_eq!(jumps.len(), 2, "{jumps:?}");
        for ([from, to], edge) in jumps.iter().zip([0.395, 0.495]) {
            assert!(from < &edge && &edge < to && to - from < 0.031, "{jumps:?}");
        }
        let mains = |i: u32| 0.2 * (f64::from(i) * 2.1).sin();
        let knots = (0..100).map(|i| knot_at(i, mains(i))).collect();
        assert!(HeadPath::new(zero, knots, Span::from_micros(50_000)).jumps_s().is_empty());
    }
}
