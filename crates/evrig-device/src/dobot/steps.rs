//! A path's steps as commands for the arm's queue.

use super::command::{CartesianLimits, Command, CpLimits, PtpMode, Ratios, XyzR};
use evrig_core::units::MillimetresPerSecond;
use evrig_session::rig::Pose;
use evrig_session::trajectory::{MotionCommand, PathStep, Rates};

/// How a circle is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CircleAs {
    /// As one command (102): no stop on the way.
    Circle,
    /// As two arcs a turn (101), which every firmware knows; the arm stops between them.
    Arcs,
}

/// The full speed that was set: ratios would only hide it.
pub(super) const FULL: Ratios = Ratios { velocity: 100.0, acceleration: 100.0 };

/// The speeds of a step, as every kind of motion reads them: documents disagree whether arcs run
/// at the ARC or the PTP parameters, so both say the same.
pub(super) fn rate_commands(rates: &Rates) -> [Command; 3] {
    let limits = cartesian_limits(rates);
    [Command::PtpCoordinate(limits), Command::ArcParams(limits), Command::PtpCommon(FULL)]
}

/// The rates in the terms of commands 81 and 100.
pub(super) fn cartesian_limits(rates: &Rates) -> CartesianLimits {
    CartesianLimits {
        xyz_velocity: rates.speed.0 as f32,
        r_velocity: rates.turn_speed.0 as f32,
        xyz_acceleration: rates.acceleration.0 as f32,
        r_acceleration: rates.turn_acceleration.0 as f32,
    }
}

/// What the arm is told for one step: its speeds, then its motion.
pub(super) fn commands(step: &PathStep, circle: CircleAs) -> Vec<Command> {
    let mut commands = Vec::new();
    let motion = step.curve.motion();
    if motion != MotionCommand::Hold {
        commands.extend(rate_commands(&step.rates));
    }
    let (from, to) = (step.curve.from(), step.curve.to());
    match motion {
        MotionCommand::Hold => commands.extend(waits(step.duration.as_nanos())),
        MotionCommand::Line => {
            commands.push(Command::Ptp { mode: PtpMode::MoveLineXyz, target: wire(to) });
        }
        MotionCommand::Arc { via } => commands.push(Command::Arc { via: wire(via), to: wire(to) }),
        MotionCommand::Circle { via, opposite, turns } => match circle {
            CircleAs::Circle => {
                commands.push(Command::Circle { via: wire(via), to: wire(opposite), turns });
            }
            CircleAs::Arcs => {
                // The way back leads through the point across from `via`.
                let back = across(via, from, opposite);
                for _ in 0..turns {
                    commands.push(Command::Arc { via: wire(via), to: wire(opposite) });
                    commands.push(Command::Arc { via: wire(back), to: wire(from) });
                }
            }
        },
        MotionCommand::Points(poses) => {
            commands.push(Command::CpParams(cp_limits(&step.rates)));
            commands.extend(thinned(poses, step.rates.speed).skip(1).map(|pose| {
                let [x, y, z, _] = wire(pose);
                Command::Cp { is_absolute: true, xyz: [x, y, z], velocity: 0.0 }
            }));
        }
    }
    commands
}

/// The points of a curve as far apart as the wire can bring them while the arm drives: a command
/// takes some 5 ms there and back, and the pose has to be asked for in between.
fn thinned(poses: &[Pose], speed: MillimetresPerSecond) -> impl Iterator<Item = Pose> {
    /// Seconds from point to point.
    const APART_S: f64 = 0.025;
    let apart_mm = speed.0 * APART_S;
    let mut last: Option<Pose> = None;
    let end = poses.len().saturating_sub(1);
    poses.iter().enumerate().filter_map(move |(n, pose)| {
        let is_kept = n == end || last.is_none_or(|last| last.distance(*pose).0 >= apart_mm);
        if is_kept {
            last = Some(*pose);
        }
        is_kept.then_some(*pose)
    })
}

/// Queue waits of whole milliseconds; a command holds 49 days at most.
fn waits(nanos: i64) -> impl Iterator<Item = Command> {
    let mut rest_ms = u64::try_from(nanos / 1_000_000).unwrap_or(0);
    std::iter::from_fn(move || {
        let now_ms = u32::try_from(rest_ms).unwrap_or(u32::MAX);
        rest_ms -= u64::from(now_ms);
        (now_ms > 0).then_some(Command::Wait(now_ms))
    })
}

fn cp_limits(rates: &Rates) -> CpLimits {
    CpLimits {
        plan_acceleration: rates.acceleration.0 as f32,
        junction_velocity: rates.speed.0 as f32,
        acceleration: rates.acceleration.0 as f32,
        is_real_time: false,
    }
}

/// The point of a circle across from `via`, `from` and `opposite` lying on a diameter.
fn across(via: Pose, from: Pose, opposite: Pose) -> Pose {
    let [a, b, c] = [via, from, opposite].map(Pose::to_mm_deg);
    let mut across: [f64; 4] = std::array::from_fn(|axis| b[axis] + c[axis] - a[axis]);
    across[3] = a[3];
    Pose::from_mm_deg(across)
}

/// A pose as the arm takes it.
pub(super) fn wire(pose: Pose) -> XyzR {
    pose.to_mm_deg().map(|value| value as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::time::Span;
    use evrig_core::units::{
        DegreesPerSecond, DegreesPerSecond2, MillimetresPerSecond, MillimetresPerSecond2,
    };
    use evrig_session::trajectory::{StepSettings, ToolCurve, ToolPath};

    fn rates() -> Rates {
        Rates {
            speed: MillimetresPerSecond(50.0),
            acceleration: MillimetresPerSecond2(60.0),
            turn_speed: DegreesPerSecond(70.0),
            turn_acceleration: DegreesPerSecond2(80.0),
        }
    }

    fn circle(turns: u32) -> ToolPath {
        let [a, b, c] = [[240.0, 0.0], [252.0, 12.0], [264.0, 0.0]]
            .map(|[x, y]| Pose::from_mm_deg([x, y, 100.0, 90.0]));
        let mut path = ToolPath::new(a);
        let curve = ToolCurve::circle(a, b, c, turns).unwrap();
        path.push("circle", 0, curve, rates(), StepSettings::default());
        path.push_hold("rest", 1, Span::from_micros(1_500_000), rates(), StepSettings::default());
        path
    }

    fn near(a: XyzR, b: XyzR) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3)
    }

    #[test]
    fn a_circle_is_one_command_behind_speeds_that_all_agree() {
        let path = circle(3);
        let commands = commands(&path.steps()[0], CircleAs::Circle);
        let [Command::PtpCoordinate(ptp), Command::ArcParams(arc), Command::PtpCommon(FULL), last] =
            commands[..]
        else {
            panic!("{commands:?}");
        };
        assert_eq!(ptp, arc);
        assert_eq!((ptp.xyz_velocity, ptp.r_acceleration), (50.0, 80.0));
        let Command::Circle { via, to, turns: 3 } = last else { panic!("{last:?}") };
        assert!(near(via, [252.0, 12.0, 100.0, 90.0]) && near(to, [264.0, 0.0, 100.0, 90.0]));
    }

    #[test]
    fn an_old_firmware_drives_the_same_circle_as_two_arcs_a_turn() {
        let path = circle(2);
        let commands = commands(&path.steps()[0], CircleAs::Arcs);
        let arcs: Vec<_> = commands
            .iter()
            .filter_map(|command| match command {
                Command::Arc { via, to } => Some((*via, *to)),
                _ => None,
            })
            .collect();
        assert_eq!(arcs.len(), 4);
        assert!(near(arcs[1].0, [252.0, -12.0, 100.0, 90.0]), "{arcs:?}");
        assert!(near(arcs[1].1, [240.0, 0.0, 100.0, 90.0]), "{arcs:?}");
    }

    #[test]
    fn points_closer_than_the_wire_can_bring_them_are_left_out_but_never_the_ends() {
        let poses: Vec<Pose> = (0..=1_000)
            .map(|n| Pose::from_mm_deg([200.0 + f64::from(n) * 0.01, 0.0, 0.0, 0.0]))
            .collect();
        let kept: Vec<Pose> = thinned(&poses, MillimetresPerSecond(40.0)).collect();
        assert_eq!(kept.len(), 11, "10 mm, a point a millimetre");
        assert_eq!((kept[0], kept[10]), (poses[0], poses[1_000]));
        assert_eq!(thinned(&[], MillimetresPerSecond(40.0)).count(), 0);
    }

    #[test]
    fn standing_still_is_a_wait_of_its_length() {
        let path = circle(1);
        assert_eq!(commands(&path.steps()[1], CircleAs::Circle), [Command::Wait(1_500)]);
        let long: Vec<_> = waits(i64::from(u32::MAX) * 1_000_000 + 5_000_000).collect();
        assert_eq!(long, [Command::Wait(u32::MAX), Command::Wait(5)]);
    }
}
