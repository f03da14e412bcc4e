//! A path against the arm's limits, point by point.

use super::{Path, Step};
use crate::rig::{ArmDescription, Gauge, Pose, ToolRates};
use crate::time::Span;
use crate::units::{
    DegreesPerSecond, DegreesPerSecond2, Millimetres, MillimetresPerSecond, MillimetresPerSecond2,
};
use serde::Serialize;
use std::fmt;

/// Points at which a step is looked at lie no farther apart than this, nor turn farther.
const SPACING_MM: f64 = 0.25;
const SPACING_DEG: f64 = 0.25;

/// About so many points on the whole of a very long path; they lie wider apart then. It is prime,
/// so that on a circle of very many turns they do not fall on the same places turn after turn.
const MAX_POINTS: f64 = 1_000_003.0;

/// How near a path comes to one limit, and where.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Margin {
    /// The quantity and its limits.
    #[serde(flatten)]
    pub gauge: Gauge,
    /// Room to the nearer limit in the gauge's unit; negative beyond it.
    pub margin: f64,
    /// Which step.
    pub segment: String,
    /// When, from the path's beginning.
    pub time_s: f64,
    /// Where the tool is then.
    pub pose: Pose,
}

impl Margin {
    fn new(gauge: Gauge, step: &Step, since: Span) -> Self {
        let pose = step.pose_at(since);
        let time_s = (step.start + since).as_secs_f64();
        Self { gauge, margin: gauge.margin(), segment: step.label.clone(), time_s, pose }
    }
}

impl fmt::Display for Margin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { gauge, segment, time_s, pose, .. } = self;
        write!(f, "segment `{segment}` at {time_s:.3} s ({pose}): {gauge}")
    }
}

/// What a walk along a path found.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Walk {
    /// The narrowest margin to every limit.
    pub(super) narrowest: Vec<Margin>,
    /// The first point beyond each limit that is exceeded, in the order of time.
    pub(super) offences: Vec<Margin>,
}

impl Walk {
    /// Looks at every step of the path; a path of no steps is looked at where it begins.
    pub(super) fn along(path: &Path, arm: &ArmDescription) -> Self {
        let mut walk = Self::default();
        let turns: f64 = path.steps().iter().map(|step| step.curve.turn().abs().0).sum();
        let n_wanted = path.length().0 / SPACING_MM + turns / SPACING_DEG;
        let thinning = (n_wanted / MAX_POINTS).max(1.0);
        for step in path.steps() {
            for gauge in arm.gauge_rates(&asked(step)) {
                walk.note(gauge, step, Span::ZERO);
            }
            let n_points = points(step, thinning);
            for i in 0..=n_points {
                let share = i as f64 / n_points.max(1) as f64;
                let since = Span::from_secs_f64(step.duration.as_secs_f64() * share);
                let (gauges, joints) = arm.gauge_pose(step.pose_at(since));
                gauges.into_iter().for_each(|gauge| walk.note(gauge, step, since));
                if let Some(joints) = joints {
                    let speeds = arm.gauge_joint_speeds(joints, step.velocity_at(since));
                    speeds.into_iter().for_each(|gauge| walk.note(gauge, step, since));
                }
            }
        }
        walk
    }

    fn note(&mut self, gauge: Gauge, step: &Step, since: Span) {
        match self.narrowest.iter_mut().find(|margin| margin.gauge.limit == gauge.limit) {
            Some(known) if gauge.margin() < known.margin => {
                *known = Margin::new(gauge, step, since);
            }
            Some(_) => {}
            None => self.narrowest.push(Margin::new(gauge, step, since)),
        }
        let is_first = || self.offences.iter().all(|known| known.gauge.limit != gauge.limit);
        if gauge.is_exceeded() && is_first() {
            self.offences.push(Margin::new(gauge, step, since));
        }
    }
}

/// What a step asks for. A speed that a short way never reaches counts: the arm is sent it.
fn asked(step: &Step) -> ToolRates {
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

fn points(step: &Step, thinning: f64) -> usize {
    let by_way = step.curve.length().0 / SPACING_MM;
    let by_turn = step.curve.turn().abs().0 / SPACING_DEG;
    let is_still = by_way == 0.0 && by_turn == 0.0;
    if is_still { 0 } else { (by_way.max(by_turn) / thinning).ceil().max(32.0) as usize }
}

/// The largest rates over the whole path.
pub(super) fn peaks(path: &Path) -> ToolRates {
    let zero = ToolRates::default();
    path.steps().iter().fold(zero, |most, step| {
        let asked = asked(step);
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
                most.curve_acceleration.0.max(asked.curve_acceleration.0),
            ),
            turn_speed: DegreesPerSecond(most.turn_speed.0.max(turn_speed)),
            turn_acceleration: DegreesPerSecond2(
                most.turn_acceleration.0.max(asked.turn_acceleration.0),
            ),
        }
    })
}
