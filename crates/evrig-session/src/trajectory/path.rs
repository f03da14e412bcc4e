//! A trajectory made concrete: motions from rest to rest, one after another, and where the tool is
//! when.

use super::{ToolCurve, Trapezoid};
use crate::rig::Pose;
use evrig_core::time::Span;
use evrig_core::units::{
    DegreesPerSecond, DegreesPerSecond2, Millimetres, MillimetresPerSecond, MillimetresPerSecond2,
};
use serde::Serialize;
use std::collections::BTreeMap;

/// How fast a motion may go: its highest speed and the acceleration of its ramps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rates {
    /// Of the tool point.
    #[serde(rename = "speed_mm_per_s")]
    pub speed: MillimetresPerSecond,
    /// Of the tool point.
    #[serde(rename = "acceleration_mm_per_s2")]
    pub acceleration: MillimetresPerSecond2,
    /// Of the wrist.
    #[serde(rename = "turn_speed_deg_per_s")]
    pub turn_speed: DegreesPerSecond,
    /// Of the wrist.
    #[serde(rename = "turn_acceleration_deg_per_s2")]
    pub turn_acceleration: DegreesPerSecond2,
}

/// What else holds during a step; what is absent is as the rig states it.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct StepSettings {
    /// Shown to the operator, who confirms before the step begins.
    pub prompt: Option<String>,
    /// Whether the DAVIS takes frames.
    pub aps: Option<bool>,
    /// Exposure of the frame cameras, as a multiple of the rig's.
    pub exposure_scale: Option<f64>,
    /// The light, as a share (0..=1) of the rig's full light.
    pub light_level: Option<f64>,
    /// Flashes of the light at the step's beginning, visible to every camera.
    pub n_flashes: u32,
    /// Biases of the DAVIS that differ from the rig's, in the driver's names and units.
    pub biases: BTreeMap<String, u16>,
}

/// One motion from rest to rest. The arm does not blend steps: it stops at every corner.
#[derive(Debug, Clone, PartialEq)]
pub struct PathStep {
    /// What the description calls it; the same for every motion of one segment.
    pub label: String,
    /// Number of the segment in the description it comes from, from 0.
    pub segment: usize,
    /// Where the tool goes; a line of no length for a standstill.
    pub curve: ToolCurve,
    /// How fast.
    pub rates: Rates,
    /// What else holds meanwhile.
    pub settings: StepSettings,
    /// When it begins, from the path's beginning.
    pub start: Span,
    /// How long it takes.
    pub duration: Span,
    way: Trapezoid,
}

/// Steps one after another, each beginning where and when the last one ended.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolPath {
    start: Pose,
    steps: Vec<PathStep>,
}

/// One instant of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Time from the path's beginning.
    pub time: Span,
    /// Index of the step.
    pub step: usize,
    /// Where the tool is.
    pub pose: Pose,
    /// How fast the tool point goes.
    pub speed: MillimetresPerSecond,
}

impl PathStep {
    /// Where the tool is, `since` the step's beginning; held at both ends.
    #[must_use]
    pub fn pose_at(&self, since: Span) -> Pose {
        self.curve.pose_at(self.part_at(since))
    }

    /// Speed of the tool point, `since` the step's beginning.
    #[must_use]
    pub fn speed_at(&self, since: Span) -> MillimetresPerSecond {
        let per_part = self.way.speed_at(since.as_secs_f64()) / self.way.distance().max(1e-300);
        MillimetresPerSecond(per_part * self.curve.length().0)
    }

    /// The speed it reaches.
    #[must_use]
    pub fn peak_speed(&self) -> MillimetresPerSecond {
        let per_part = self.way.peak_speed() / self.way.distance().max(1e-300);
        MillimetresPerSecond(per_part * self.curve.length().0)
    }

    /// The acceleration of its ramps along the path.
    #[must_use]
    pub fn ramp_acceleration(&self) -> MillimetresPerSecond2 {
        let per_part = self.way.acceleration() / self.way.distance().max(1e-300);
        MillimetresPerSecond2(per_part * self.curve.length().0)
    }

    /// Seconds of the step at constant speed.
    #[must_use]
    pub fn cruise_seconds(&self) -> f64 {
        self.way.cruise_seconds()
    }

    /// Velocity `[mm/s, mm/s, mm/s, deg/s]` of the tool, `since` the step's beginning.
    #[must_use]
    pub fn velocity_at(&self, since: Span) -> [f64; 4] {
        let parts_per_s = self.way.speed_at(since.as_secs_f64()) / self.way.distance().max(1e-300);
        self.curve.slope_at(self.part_at(since)).map(|slope| slope * parts_per_s)
    }

    fn part_at(&self, since: Span) -> f64 {
        if self.way.distance() > 0.0 {
            self.way.distance_at(since.as_secs_f64()) / self.way.distance()
        } else {
            0.0
        }
    }
}

impl ToolPath {
    /// A path of no steps yet.
    #[must_use]
    pub fn new(start: Pose) -> Self {
        Self { start, steps: Vec::new() }
    }

    /// Appends a motion; its duration follows from its rates, the slower of way and wrist leading.
    pub fn push(
        &mut self,
        label: &str,
        segment: usize,
        curve: ToolCurve,
        rates: Rates,
        settings: StepSettings,
    ) {
        let way = Trapezoid::new(curve.length().0, rates.speed.0, rates.acceleration.0);
        let turn =
            Trapezoid::new(curve.turn().abs().0, rates.turn_speed.0, rates.turn_acceleration.0);
        let way = if way.distance() > 0.0 { way.stretched_to(turn.seconds()) } else { turn };
        let (label, start, duration) = (label.to_owned(), self.duration(), way.duration());
        self.steps.push(PathStep { label, segment, curve, rates, settings, start, duration, way });
    }

    /// Appends a standstill.
    pub fn push_hold(
        &mut self,
        label: &str,
        segment: usize,
        duration: Span,
        rates: Rates,
        settings: StepSettings,
    ) {
        let here = self.end();
        self.push(label, segment, ToolCurve::line(here, here), rates, settings);
        if let Some(step) = self.steps.last_mut() {
            step.duration = duration;
        }
    }

    /// Where it begins.
    #[must_use]
    pub fn start(&self) -> Pose {
        self.start
    }

    /// Where it ends.
    #[must_use]
    pub fn end(&self) -> Pose {
        self.steps.last().map_or(self.start, |step| step.curve.to())
    }

    /// The motions in order.
    #[must_use]
    pub fn steps(&self) -> &[PathStep] {
        &self.steps
    }

    /// How long all of it takes.
    #[must_use]
    pub fn duration(&self) -> Span {
        self.steps.last().map_or(Span::ZERO, |step| step.start + step.duration)
    }

    /// Way of the tool point.
    #[must_use]
    pub fn length(&self) -> Millimetres {
        self.steps.iter().fold(Millimetres(0.0), |sum, step| sum + step.curve.length())
    }

    /// The instant `time` from the beginning; held at both ends. None on a path of no steps.
    #[must_use]
    pub fn at(&self, time: Span) -> Option<PathPoint> {
        let after = self.steps.partition_point(|step| step.start <= time);
        let step_index = after.saturating_sub(1);
        let step = self.steps.get(step_index)?;
        let since = time - step.start;
        Some(PathPoint {
            time,
            step: step_index,
            pose: step.pose_at(since),
            speed: step.speed_at(since),
        })
    }

    /// Instants a `period` apart from the beginning to the end, both included; none on a path of no
    /// steps.
    pub fn every(&self, period: Span) -> impl Iterator<Item = PathPoint> + '_ {
        let (period, end) = (period.as_nanos().max(1), self.duration().as_nanos());
        let inner = (0..=end / period).map(move |i| i * period);
        let last = (end % period != 0).then_some(end);
        inner.chain(last).filter_map(|time| self.at(Span::from_nanos(time)))
    }

    /// Where the tool is, `time` from the beginning; held at both ends.
    #[must_use]
    pub fn pose_at(&self, time: Span) -> Pose {
        self.at(time).map_or(self.start, |point| point.pose)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rates() -> Rates {
        Rates {
            speed: MillimetresPerSecond(50.0),
            acceleration: MillimetresPerSecond2(50.0),
            turn_speed: DegreesPerSecond(50.0),
            turn_acceleration: DegreesPerSecond2(50.0),
        }
    }

    fn circle_and_rest() -> ToolPath {
        let [a, b, c] = [[240.0, 0.0], [252.0, 12.0], [264.0, 0.0]]
            .map(|[x, y]| Pose::from_mm_deg([x, y, 100.0, 90.0]));
        let mut path = ToolPath::new(a);
        path.push_hold("before", 0, Span::from_micros(500_000), rates(), StepSettings::default());
        let circle = ToolCurve::circle(a, b, c, 1).unwrap();
        path.push("circle", 1, circle, rates(), StepSettings::default());
        path.push_hold("after", 2, Span::from_micros(500_000), rates(), StepSettings::default());
        path
    }

    #[test]
    fn steps_follow_each_other_in_time() {
        let path = circle_and_rest();
        let expected = 1.0 + std::f64::consts::TAU * 12.0 / 50.0 + 1.0;
        assert!((path.duration().as_secs_f64() - expected).abs() < 1e-8);
        assert_eq!(path.steps()[2].start, path.steps()[1].start + path.steps()[1].duration);
        let middle = Span::from_secs_f64(expected / 2.0);
        let point = path.at(middle).unwrap();
        assert_eq!(point.step, 1);
        assert!((point.pose.x.0 - 264.0).abs() < 1e-6 && (point.speed.0 - 50.0).abs() < 1e-9);
    }

    #[test]
    fn instants_come_evenly_and_the_end_is_among_them() {
        let path = circle_and_rest();
        let points: Vec<_> = path.every(Span::from_micros(20_000)).collect();
        let n_whole = path.duration().as_nanos() / 20_000_000;
        assert_eq!(points.len() as i64, n_whole + 2);
        assert_eq!(points[7].time, Span::from_micros(140_000));
        assert_eq!(points.last().unwrap().time, path.duration());
    }

    #[test]
    fn before_and_after_the_path_the_tool_rests_at_its_ends() {
        let path = circle_and_rest();
        assert_eq!(path.pose_at(Span::from_secs_f64(-1.0)), path.start());
        assert!(path.pose_at(Span::from_secs_f64(99.0)).distance(path.end()).0 < 1e-9);
        assert!(path.at(Span::from_secs_f64(99.0)).unwrap().speed.0.abs() < 1e-12);
        assert_eq!(ToolPath::new(path.start()).pose_at(Span::ZERO), path.start());
    }

    #[test]
    fn the_wrist_leads_when_it_is_slower_than_the_way() {
        let from = Pose::from_mm_deg([240.0, 0.0, 100.0, 0.0]);
        let to = Pose::from_mm_deg([241.0, 0.0, 100.0, 100.0]);
        let mut path = ToolPath::new(from);
        path.push("turn", 0, ToolCurve::line(from, to), rates(), StepSettings::default());
        assert!((path.duration().as_secs_f64() - (100.0 / 50.0 + 1.0)).abs() < 1e-8);
        let half = path.pose_at(Span::from_secs_f64(1.5));
        assert!((half.r.0 - 50.0).abs() < 1e-6 && (half.x.0 - 240.5).abs() < 1e-6);
    }
}
