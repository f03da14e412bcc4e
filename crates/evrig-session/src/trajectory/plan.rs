//! The plan of a trajectory on a rig: margins, visibility, duration, data volume.

use super::disk::{StreamSize, stream_sizes};
use super::margin::{LimitScan, Margin, peaks};
use super::remark::{check_exposures, remarks};
use super::view::{TargetVisibility, views};
use super::{OptionalSegments, PathError, PathStep, StepSettings, ToolPath, Trajectory};
use crate::rig::{Joints, Pose, Rig};
use evrig_core::time::Span;
use serde::Serialize;

/// At most so many evenly spread points of the profile are kept; a screen shows no more.
const PROFILE_POINTS: usize = 1000;

/// The plan of a trajectory on a rig.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// The trajectory's name.
    pub trajectory: String,
    /// The rig's name.
    pub rig: String,
    /// Whether no limit is exceeded.
    pub is_feasible: bool,
    /// The first point beyond each limit that is exceeded, in the order of time.
    pub violations: Vec<Margin>,
    /// How long it takes.
    pub duration_s: f64,
    /// Way of the tool point.
    pub length_mm: f64,
    /// The highest speed that is reached.
    pub peak_speed_mm_per_s: f64,
    /// The highest acceleration of a ramp.
    pub peak_acceleration_mm_per_s2: f64,
    /// The highest acceleration across the path.
    pub peak_curve_acceleration_mm_per_s2: f64,
    /// The highest speed of the wrist in the base frame.
    pub peak_turn_speed_deg_per_s: f64,
    /// What happens between two motions: the arm stops, since its planner does not blend commands.
    pub corners: &'static str,
    /// Segment by segment; repeats and sweeps motion by motion.
    pub segments: Vec<SegmentPlan>,
    /// The narrowest margin to every limit.
    pub margins: Vec<Margin>,
    /// Visibility of the target; empty when the rig does not state where it is.
    pub views: Vec<TargetVisibility>,
    /// Remarks for the operator.
    pub remarks: Vec<String>,
    /// Bytes per stream.
    pub disk: Vec<StreamSize>,
    /// Bytes of all streams.
    pub disk_bytes: u64,
    /// Instants evenly spread over time, and the beginnings of the motions.
    pub profile: Vec<ProfilePoint>,
    /// The path itself.
    #[serde(skip)]
    pub path: ToolPath,
}

/// One motion of a plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SegmentPlan {
    /// Its name; parts of a repeat or a sweep after a slash.
    pub label: String,
    /// When it begins.
    pub start_s: f64,
    /// How long it takes.
    pub duration_s: f64,
    /// Way of the tool point.
    pub length_mm: f64,
    /// The speed it reaches.
    pub peak_speed_mm_per_s: f64,
    /// The acceleration of its ramps.
    pub acceleration_mm_per_s2: f64,
    /// Share of its time at constant speed, 0..=1.
    pub cruise_share: f64,
    /// What else holds meanwhile.
    pub settings: StepSettings,
}

/// One instant of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ProfilePoint {
    /// From the path's beginning.
    pub time_s: f64,
    /// Where the tool is.
    #[serde(flatten)]
    pub pose: Pose,
    /// Where the joints are; none out of reach.
    pub joints: Option<Joints>,
    /// How fast the tool point goes.
    pub speed_mm_per_s: f64,
}

/// A path that the arm must not run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("the arm cannot run `{trajectory}`: {offence}")]
pub struct Infeasible {
    /// The trajectory's name.
    pub trajectory: String,
    /// The first point beyond a limit.
    pub offence: Box<Margin>,
}

impl Plan {
    /// Explains `trajectory` on `rig`.
    ///
    /// # Errors
    /// When a segment makes no curve, or asks for an exposure that a frame has no time for. A path
    /// beyond a limit is not an error: see [`Plan::violations`].
    pub fn new(
        trajectory: &Trajectory,
        rig: &Rig,
        optional: OptionalSegments,
    ) -> Result<Self, PathError> {
        let path = trajectory.path(rig, optional)?;
        check_exposures(&path, rig)?;
        let walk = LimitScan::along(&path, &rig.arm);
        let peaks = peaks(&path);
        let disk = stream_sizes(&path, rig);
        let views = views(&path, rig);
        Ok(Self {
            trajectory: trajectory.name.clone(),
            rig: rig.name.clone(),
            is_feasible: walk.violations.is_empty(),
            violations: walk.violations,
            duration_s: path.duration().as_secs_f64(),
            length_mm: path.length().0,
            peak_speed_mm_per_s: peaks.speed.0,
            peak_acceleration_mm_per_s2: peaks.acceleration.0,
            peak_curve_acceleration_mm_per_s2: peaks.curve_acceleration.0,
            peak_turn_speed_deg_per_s: peaks.turn_speed.0,
            corners: "stopped",
            segments: path.steps().iter().map(SegmentPlan::new).collect(),
            margins: walk.narrowest,
            remarks: remarks(&path, rig, &views),
            views,
            disk_bytes: disk.iter().map(|stream| stream.bytes).sum(),
            disk,
            profile: profile(&path, rig),
            path,
        })
    }

    /// The path, when the arm may run it.
    ///
    /// # Errors
    /// With the first point beyond a limit.
    pub fn feasible_path(&self) -> Result<&ToolPath, Infeasible> {
        match self.violations.first() {
            None => Ok(&self.path),
            Some(offence) => Err(Infeasible {
                trajectory: self.trajectory.clone(),
                offence: Box::new(offence.clone()),
            }),
        }
    }
}

impl SegmentPlan {
    fn new(step: &PathStep) -> Self {
        let duration_s = step.duration.as_secs_f64();
        let cruise = if duration_s > 0.0 { step.cruise_seconds() / duration_s } else { 0.0 };
        Self {
            label: step.label.clone(),
            start_s: step.start.as_secs_f64(),
            duration_s,
            length_mm: step.curve.length().0,
            peak_speed_mm_per_s: step.peak_speed().0,
            acceleration_mm_per_s2: step.ramp_acceleration().0,
            cruise_share: cruise.clamp(0.0, 1.0),
            settings: step.settings.clone(),
        }
    }
}

fn profile(path: &ToolPath, rig: &Rig) -> Vec<ProfilePoint> {
    let seconds = path.duration().as_secs_f64();
    let n_points = ((seconds / 0.005).ceil() as usize).clamp(1, PROFILE_POINTS);
    let even = (0..=n_points).map(|i| seconds * i as f64 / n_points as f64);
    let mut times: Vec<Span> = even.map(Span::from_secs_f64).collect();
    // The standstills between motions, which evenly spread instants would miss.
    times.extend(path.steps().iter().take(PROFILE_POINTS).map(|step| step.start));
    times.sort_unstable();
    times.dedup();
    let points = times.into_iter().filter_map(|time| {
        let point = path.at(time)?;
        Some(ProfilePoint {
            time_s: time.as_secs_f64(),
            pose: point.pose,
            joints: rig.arm.kinematics.inverse(point.pose).ok(),
            speed_mm_per_s: point.speed.0,
        })
    });
    points.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn plan(name: &str) -> Plan {
        plan_of(&Trajectory::find(name).unwrap())
    }

    fn plan_of(trajectory: &Trajectory) -> Plan {
        Plan::new(trajectory, &Rig::simulated().unwrap(), OptionalSegments::Included).unwrap()
    }

    fn changed(name: &str, changes: &[(&str, &str)]) -> Plan {
        let mut text = Trajectory::find(name).unwrap().text;
        for (from, to) in changes {
            assert!(text.contains(from), "{name} has no `{from}`");
            text = text.replace(from, to);
        }
        plan_of(&Trajectory::parse("changed.toml", &text).unwrap())
    }

    #[test]
    fn every_bundled_trajectory_runs_on_both_bundled_rigs() {
        for rig in ["sim", "magician"].map(|name| Rig::find(name).unwrap()) {
            for name in Trajectory::bundled_names() {
                let trajectory = Trajectory::find(name).unwrap();
                let plan = Plan::new(&trajectory, &rig, OptionalSegments::Included).unwrap();
                assert!(plan.is_feasible, "{name} on {}: {:?}", rig.name, plan.violations);
                for view in &plan.views {
                    let seen = view.target_visible;
                    assert!((seen - 1.0).abs() < 1e-12, "{name}: {} sees it {seen}", view.camera);
                }
            }
        }
    }

    #[test]
    fn the_published_circle_takes_what_the_closed_form_gives() {
        let plan = plan("circle");
        let circle = &plan.segments[1];
        assert!((circle.duration_s - (TAU * 12.0 / 50.0 + 50.0 / 50.0)).abs() < 1e-8);
        assert!((circle.duration_s - 2.508).abs() < 5e-4);
        assert!((plan.length_mm - TAU * 12.0).abs() < 1e-9);
        assert!((circle.cruise_share * circle.duration_s - 0.508).abs() < 5e-4);
        assert!((plan.peak_curve_acceleration_mm_per_s2 - 50.0 * 50.0 / 12.0).abs() < 1e-6);
    }

    #[test]
    fn the_published_circle_is_the_one_of_the_published_program() {
        // Its circle command names these two points after a start at (240, 0, 100, 90).
        let path = plan("circle").path;
        let crate::trajectory::MotionCommand::Circle { via, opposite, turns } =
            path.steps()[1].curve.motion()
        else {
            panic!("{:?}", path.steps()[1])
        };
        assert_eq!(path.start(), Pose::from_mm_deg([240.0, 0.0, 100.0, 90.0]));
        assert!(via.distance(Pose::from_mm_deg([252.0, 12.0, 100.0, 90.0])).0 < 1e-9, "{via}");
        let far = Pose::from_mm_deg([264.0, 0.0, 100.0, 90.0]);
        assert!(opposite.distance(far).0 < 1e-9 && turns == 1, "{opposite}");
    }

    #[test]
    fn the_wrist_margin_on_the_published_circle_is_known() {
        let plan = plan("circle");
        let wrist = plan.margins.iter().find(|m| m.gauge.limit == "joint J4").unwrap();
        // J4 = 90 + asin(12 / 252) at most; the simulated wrist goes to 150.
        let highest = 90.0 + (12.0_f64 / 252.0).asin().to_degrees();
        assert!((wrist.gauge.value - highest).abs() < 1e-3, "{wrist}");
        assert!((wrist.margin - (150.0 - highest)).abs() < 1e-3);
    }

    #[test]
    fn out_of_reach_is_refused_with_the_first_point_beyond() {
        let plan =
            changed("circle", &[("x_mm = 240.0", "x_mm = 305.0"), ("z_mm = 100.0", "z_mm = 0.0")]);
        let refused = plan.feasible_path().unwrap_err();
        let Margin { segment, gauge, pose, time_s, .. } = &*refused.offence;
        assert_eq!((segment.as_str(), gauge.limit), ("circle", "workspace radius"));
        let radius = pose.x.0.hypot(pose.y.0);
        assert!(
            (320.0..320.5).contains(&radius),
            "the first point beyond, not the farthest: {pose}"
        );
        assert!((plan.path.pose_at(Span::from_secs_f64(*time_s)).distance(*pose)).0 < 1e-6);
        let message = refused.to_string();
        for part in ["circle", "allowed 140 to 320 mm", "mm over", "x "] {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    #[test]
    fn what_the_stretched_arm_cannot_reach_is_named_as_reach() {
        let plan = changed("circle", &[("z_mm = 100.0", "z_mm = 280.0")]);
        let limits: Vec<_> = plan.violations.iter().map(|offence| offence.gauge.limit).collect();
        assert!(limits.contains(&"reach from the shoulder"), "{limits:?}");
        assert!(limits.contains(&"workspace z"), "{limits:?}");
    }

    #[test]
    fn a_speed_over_the_limit_is_refused_even_if_the_way_is_too_short_to_reach_it() {
        let plan = changed("circle", &[("speed_mm_per_s = 50.0", "speed_mm_per_s = 301.0")]);
        let offence = plan.feasible_path().unwrap_err().offence;
        assert_eq!(offence.gauge.limit, "speed");
        assert!((offence.margin + 1.0).abs() < 1e-9);
        assert!(plan.peak_speed_mm_per_s < 100.0);
    }

    #[test]
    fn a_wrist_that_turns_too_far_is_refused_at_the_right_angle() {
        let line = "by_mm = [24.0, 0.0]";
        let plan = changed("line", &[(line, &format!("{line}\nturn_deg = 80.0"))]);
        let offence = plan.feasible_path().unwrap_err().offence;
        assert_eq!((offence.gauge.limit, offence.segment.as_str()), ("joint J4", "there"));
        assert!((150.0..150.3).contains(&offence.gauge.value), "{offence}");
    }

    #[test]
    fn the_protocol_holds_each_part_as_long_as_stated() {
        let with = plan("protocol");
        let trajectory = Trajectory::find("protocol").unwrap();
        let rig = Rig::simulated().unwrap();
        let without = Plan::new(&trajectory, &rig, OptionalSegments::LeftOut).unwrap();
        assert!(without.segments.iter().all(|segment| segment.settings.prompt.is_none()));
        let left_out = with.duration_s - without.duration_s;
        assert!(left_out > 40.0, "dark, uncovering and refocusing alone take 42 s: {left_out}");
        let part = |label: &str| without.segments.iter().find(|s| s.label == label).unwrap();
        for label in ["slow-cw", "fast-cw", "fast-ccw", "slow-ccw"] {
            assert!((10.0..13.8).contains(&part(label).duration_s), "{label}");
        }
        let faster = part("fast-cw").peak_speed_mm_per_s / part("slow-cw").peak_speed_mm_per_s;
        assert!((faster - 2.5).abs() < 1e-9);
        assert_eq!(part("dim/fast-cw").settings.light_level, Some(0.2));
        assert_eq!(part("short-exposure/slow-cw").settings.exposure_scale, Some(0.5));
        assert_eq!(part("static-without-frames").settings.aps, Some(false));
    }

    #[test]
    fn an_exposure_longer_than_a_frame_is_refused_with_its_segment() {
        let text = Trajectory::find("protocol").unwrap().text;
        let text = text.replace("exposure_scale = 0.5", "exposure_scale = 2.5");
        let trajectory = Trajectory::parse("changed.toml", &text).unwrap();
        let rig = Rig::simulated().unwrap();
        let error = Plan::new(&trajectory, &rig, OptionalSegments::Included).unwrap_err();
        // 2.5 x 4 ms fits into the DAVIS's 25 ms, but not into the Pi's 8.3 ms.
        let message = error.to_string();
        for part in ["short-exposure/slow-cw", "pi", "10.000 ms", "8.333 ms"] {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    #[test]
    fn a_light_that_nothing_switches_is_remarked_on() {
        let protocol = Trajectory::find("protocol").unwrap();
        let on = |rig: &Rig| Plan::new(&protocol, rig, OptionalSegments::LeftOut).unwrap().remarks;
        assert_eq!(on(&Rig::simulated().unwrap()), Vec::<String>::new());
        let remarks = on(&Rig::find("magician").unwrap());
        assert!(remarks[0].starts_with("5 motions change the light"), "{remarks:?}");
    }

    #[test]
    fn the_profile_rests_between_motions() {
        let plan = plan("speed-sweep");
        let rests = plan.profile.windows(3).filter(|near| {
            near[1].speed_mm_per_s < 1e-9 && near.iter().any(|p| p.speed_mm_per_s > 0.0)
        });
        // Eight circles: a rest before each and one behind the last.
        assert_eq!(rests.count(), 9);
    }

    #[test]
    fn the_short_protocol_takes_about_five_seconds() {
        assert!((plan("protocol-short").duration_s - 5.0).abs() < 0.5);
    }

    #[test]
    fn frames_need_what_their_size_and_rate_say() {
        let plan = plan("circle");
        let raw = plan.disk.iter().find(|stream| stream.stream == "raw").unwrap();
        let expected = plan.duration_s * 120.0 * 692.0 * 520.0 * 10.0 / 8.0;
        assert!((raw.bytes as f64 - expected).abs() <= 1.0);
        assert_eq!(plan.disk_bytes, plan.disk.iter().map(|stream| stream.bytes).sum::<u64>());
    }

    #[test]
    fn a_target_that_leaves_the_image_is_counted() {
        let plan = changed("line", &[("by_mm = [24.0, 0.0]", "by_mm = [60.0, 0.0]")]);
        let pi = plan.views.iter().find(|view| view.camera == "pi").unwrap();
        assert!(pi.target_visible < 0.9 && pi.tag_visible > pi.target_visible, "{pi:?}");
    }
}
