//! Checks a path against the arm's limits, point by point.

use super::{PathStep, ToolPath};
use crate::rig::{ArmDescription, Gauge, Joints, Pose, ToolRates};
use evrig_core::time::Span;
use evrig_core::units::{
    DegreesPerSecond, DegreesPerSecond2, Millimetres, MillimetresPerSecond, MillimetresPerSecond2,
};
use serde::Serialize;
use std::fmt;

/// Largest distance and rotation between checked points of a step.
const MAX_SPACING_MM: f64 = 0.25;
const MAX_SPACING_DEG: f64 = 0.25;

/// Number of checked points of a very long path, which are farther apart then. It is prime,
/// so that on a circle of very many turns they do not fall on the same places turn after turn.
const MAX_POINTS: f64 = 1_000_003.0;

/// Checked points of a joint move: less than three degrees apart.
const JOINT_MOVE_POINTS: u32 = 128;

/// The margin of a path to one limit, and where it is smallest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Margin {
    /// The quantity and its limits.
    #[serde(flatten)]
    pub gauge: Gauge,
    /// Distance to the nearer limit in the gauge's unit; negative beyond it.
    pub margin: f64,
    /// Which step.
    pub segment: String,
    /// When, from the path's beginning; zero on the way from home to the start.
    pub time_s: f64,
    /// Where the tool is then.
    pub pose: Pose,
}

/// A checked point of a path.
struct CheckedPoint<'a> {
    segment: &'a str,
    time_s: f64,
    pose: Pose,
}

impl CheckedPoint<'_> {
    fn margin(&self, gauge: Gauge) -> Margin {
        let &Self { segment, time_s, pose } = self;
        Margin { gauge, margin: gauge.margin(), segment: segment.to_owned(), time_s, pose }
    }
}

impl fmt::Display for Margin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { gauge, segment, time_s, pose, .. } = self;
        write!(f, "segment `{segment}` at {time_s:.3} s ({pose}): {gauge}")
    }
}

/// The first point of `path` beyond each limit of `arm` that it exceeds, in the order of time;
/// empty for a path the arm may run.
#[must_use]
pub fn violations(path: &ToolPath, arm: &ArmDescription) -> Vec<Margin> {
    LimitScan::along(path, arm).violations
}

/// Margins and violations along a path.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct LimitScan {
    /// The narrowest margin to every limit.
    pub(super) narrowest: Vec<Margin>,
    /// The first point beyond each limit that is exceeded, in the order of time.
    pub(super) violations: Vec<Margin>,
}

impl LimitScan {
    /// Checks the moves from and to home and every step of the path.
    pub(super) fn along(path: &ToolPath, arm: &ArmDescription) -> Self {
        let mut walk = Self::default();
        walk.joint_move("from home to the start", 0.0, [arm.home, path.start()], arm);
        let turns: f64 = path.steps().iter().map(|step| step.curve.turn().abs().0).sum();
        let n_wanted = path.length().0 / MAX_SPACING_MM + turns / MAX_SPACING_DEG;
        let thinning = (n_wanted / MAX_POINTS).max(1.0);
        for step in path.steps() {
            walk.step(step, thinning, arm);
        }
        let end_s = path.duration().as_secs_f64();
        walk.joint_move("from the end to home", end_s, [path.end(), arm.home], arm);
        walk
    }

    fn step(&mut self, step: &PathStep, thinning: f64, arm: &ArmDescription) {
        let place = |since: Span| CheckedPoint {
            segment: &step.label,
            time_s: (step.start + since).as_secs_f64(),
            pose: step.pose_at(since),
        };
        for gauge in arm.gauge_rates(&requested_rates(step)) {
            self.note(gauge, &place(Span::ZERO));
        }
        let n_points = points(step, thinning);
        for i in 0..=n_points {
            let share = i as f64 / n_points.max(1) as f64;
            let since = Span::from_secs_f64(step.duration.as_secs_f64() * share);
            let here = place(since);
            let (gauges, joints) = arm.gauge_pose(here.pose);
            gauges.into_iter().for_each(|gauge| self.note(gauge, &here));
            if let Some(joints) = joints {
                let speeds = arm.gauge_joint_speeds(joints, step.velocity_at(since));
                speeds.into_iter().for_each(|gauge| self.note(gauge, &here));
            }
        }
    }

    /// Checks a move with linear interpolation of the joints, as the arm's MOVJ.
    fn joint_move(
        &mut self,
        segment: &str,
        time_s: f64,
        [from, to]: [Pose; 2],
        arm: &ArmDescription,
    ) {
        // Where an end is out of reach the pose itself is found wanting, as home or on the path.
        let ends = [from, to].map(|pose| arm.kinematics.inverse(pose).map(Joints::to_deg));
        let [Ok(from), Ok(to)] = ends else { return };
        for i in 0..=JOINT_MOVE_POINTS {
            let share = f64::from(i) / f64::from(JOINT_MOVE_POINTS);
            let joints = std::array::from_fn(|j| from[j] + share * (to[j] - from[j]));
            let pose = arm.kinematics.forward(Joints::from_deg(joints));
            let place = CheckedPoint { segment, time_s, pose };
            let (gauges, _) = arm.gauge_pose(pose);
            gauges.into_iter().for_each(|gauge| self.note(gauge, &place));
        }
    }

    fn note(&mut self, gauge: Gauge, place: &CheckedPoint<'_>) {
        match self.narrowest.iter_mut().find(|margin| margin.gauge.limit == gauge.limit) {
            Some(known) if gauge.margin() < known.margin => *known = place.margin(gauge),
            Some(_) => {}
            None => self.narrowest.push(place.margin(gauge)),
        }
        let is_first = || self.violations.iter().all(|known| known.gauge.limit != gauge.limit);
        if gauge.is_exceeded() && is_first() {
            self.violations.push(place.margin(gauge));
        }
    }
}

/// What a step asks for. A speed that a short way never reaches counts: the arm is sent it.
fn requested_rates(step: &PathStep) -> ToolRates {
    let mut rates = ToolRates::default();
    if step.curve.length() > Millimetres(0.0) {
        rates.speed = step.rates.speed;
        rates.acceleration = step.rates.acceleration;
        let peak = step.peak_speed().0;
        let radius = step.curve.tightest_radius();
        rates.curve_acceleration =
            MillimetresPerSecond2(radius.map_or(0.0, |radius| peak * peak / radius.0));
    }
    if step.curve.turn().abs().0 > 0.0 {
        rates.turn_speed = step.rates.turn_speed;
        rates.turn_acceleration = step.rates.turn_acceleration;
    }
    rates
}

fn points(step: &PathStep, thinning: f64) -> usize {
    let by_way = step.curve.length().0 / MAX_SPACING_MM;
    let by_turn = step.curve.turn().abs().0 / MAX_SPACING_DEG;
    let is_still = by_way == 0.0 && by_turn == 0.0;
    if is_still { 0 } else { (by_way.max(by_turn) / thinning).ceil().max(32.0) as usize }
}

/// The largest rates over the whole path.
pub(super) fn peaks(path: &ToolPath) -> ToolRates {
    let zero = ToolRates::default();
    path.steps().iter().fold(zero, |most, step| {
        let requested_rates = requested_rates(step);
        let part = |turn: f64, all: f64| if all > 0.0 { turn / all } else { 0.0 };
        let turn_share = part(step.curve.turn().abs().0, step.curve.length().0);
        let turn_speed = if step.curve.length().0 > 0.0 {
            step.peak_speed().0 * turn_share
        } else {
            step.velocity_at(Span::from_nanos(step.duration.as_nanos() / 2))[3].abs()
        };
        ToolRates {
            speed: MillimetresPerSecond(most.speed.0.max(step.peak_speed().0)),
            acceleration: MillimetresPerSecond2(
                most.acceleration.0.max(step.ramp_acceleration().0),
            ),
            curve_acceleration: MillimetresPerSecond2(
                most.curve_acceleration.0.max(requested_rates.curve_acceleration.0),
            ),
            turn_speed: DegreesPerSecond(most.turn_speed.0.max(turn_speed)),
            turn_acceleration: DegreesPerSecond2(
                most.turn_acceleration.0.max(requested_rates.turn_acceleration.0),
            ),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;
    use crate::trajectory::{OptionalSegments, Trajectory};

    fn walk(rig: &Rig, trajectory: &str, changes: &[(&str, &str)]) -> LimitScan {
        let mut text = Trajectory::find(trajectory).unwrap().text;
        for (from, to) in changes {
            assert!(text.contains(from), "no `{from}`");
            text = text.replace(from, to);
        }
        let trajectory = Trajectory::parse("changed.toml", &text).unwrap();
        LimitScan::along(&trajectory.path(rig, OptionalSegments::Included).unwrap(), &rig.arm)
    }

    fn changed_rig(from: &str, to: &str) -> Rig {
        let text = Rig::simulated().unwrap().text;
        assert!(text.contains(from), "no `{from}`");
        Rig::parse("changed.toml", &text.replace(from, to)).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn joint_speeds_on_the_published_circle_are_what_differences_of_the_joints_say() {
        let rig = Rig::simulated().unwrap();
        let path =
            Trajectory::find("circle").unwrap().path(&rig, OptionalSegments::Included).unwrap();
        let joints = |time_s: f64| {
            let pose = path.pose_at(Span::from_secs_f64(time_s));
            rig.arm.kinematics.inverse(pose).unwrap().to_deg()
        };
        let walk = LimitScan::along(&path, &rig.arm);
        for joint in 0..4 {
            let fastest = (0..35_000)
                .map(|i| f64::from(i) * 1e-4)
                .map(|t| (joints(t + 1e-4)[joint] - joints(t)[joint]).abs() / 1e-4)
                .fold(0.0, f64::max);
            let limit = format!("speed of joint J{}", joint + 1);
            let found = walk.narrowest.iter().find(|m| m.gauge.limit == limit).unwrap();
            assert!((found.gauge.value - fastest).abs() < 0.01 * fastest, "{found} not {fastest}");
        }
    }

    #[test]
    fn a_joint_that_would_go_too_fast_is_named_though_the_tool_is_slow_enough() {
        // At its far side the circle turns the base by 50 mm/s / 264 mm = 10.85 deg/s.
        let rig = changed_rig("speed_deg_per_s = [320.0,", "speed_deg_per_s = [10.8,");
        let walk = walk(&rig, "circle", &[]);
        let [only] = walk.violations.as_slice() else { panic!("{:?}", walk.violations) };
        assert_eq!(only.gauge.limit, "speed of joint J1");
        assert!(only.pose.x.0 > 263.0, "{only}");
    }

    #[test]
    fn the_way_from_home_to_the_start_is_looked_at_too() {
        // Both ends lie outside the forbidden strip, the way between them does not.
        let rig = changed_rig("y_mm = [-328.0, 328.0]", "x_mm = [150.0, 330.0]");
        let there = [("x_mm = 240.0", "x_mm = 160.0"), ("y_mm = 0.0", "y_mm = 220.0")];
        let home = "home = { x_mm = 200.0, y_mm = 0.0,";
        let text = rig.text.replace(home, "home = { x_mm = 155.0, y_mm = -150.0,");
        let rig = Rig::parse("changed.toml", &text).unwrap();
        let free = walk(&rig, "circle", &there);
        assert!(free.violations.is_empty(), "{:?}", free.violations);
        let text = rig.text.replace("x_mm = [150.0, 330.0]", "x_mm = [150.0, 200.0]");
        let rig = Rig::parse("changed.toml", &text).unwrap();
        let walk = walk(&rig, "circle", &there);
        let first = walk.violations.first().unwrap();
        assert_eq!(
            (first.segment.as_str(), first.gauge.limit),
            ("from home to the start", "workspace x")
        );
    }
}
