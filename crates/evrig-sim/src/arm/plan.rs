//! From a command to a motion, as far as the documents say how the firmware does it.
//!
//! Assumptions where they disagree: arcs and circles run at the ARC parameters
//! (one source lets the PTP parameters rule them, see [`super::ArcSpeed`]);
//! continuous-path moves cruise at the junction speed, the documents calling the
//! speed in the command reserved.

use super::motion::{ArmGeometry, ArmMotion, Leg};
use super::options::ArcSpeed;
use super::path::{ArmPoint, LegPath, SimulatedArc};
use super::profile::SpeedProfile;
use super::registers::ArmRegisters;
use evrig_device::dobot::alarm::Alarm;
use evrig_device::dobot::command::{ArmCommand, PtpMode};
use evrig_device::dobot::id;

/// What planning a command depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Planner<'a> {
    /// Tool and limits.
    pub(super) body: ArmGeometry<'a>,
    /// Speeds.
    pub(super) registers: &'a ArmRegisters,
    /// What rules the speed of an arc.
    pub(super) arc_speed: ArcSpeed,
    /// Joints at the start, deg.
    pub(super) joints: [f64; 4],
    /// Pose at the start.
    pub(super) xyzr: [f64; 4],
    /// Speed at the start, mm/s.
    pub(super) entry_speed: f64,
}

/// Speeds and accelerations along the path and of r.
#[derive(Debug, Clone, Copy)]
struct PathSpeeds {
    xyz: (f64, f64),
    r: (f64, f64),
}

impl Planner<'_> {
    /// The motion a command makes; `None` when it makes none.
    ///
    /// # Errors
    /// The alarm the arm raises instead of moving.
    pub(super) fn plan(
        &self,
        command: &ArmCommand,
        next: &[ArmCommand],
    ) -> Result<Option<ArmMotion>, Alarm> {
        Ok(Some(match command {
            ArmCommand::Ptp { mode, target } => self.ptp(*mode, wide(*target))?,
            ArmCommand::Arc { via, to } => self.arc(wide(*via), wide(*to), None)?,
            ArmCommand::Circle { via, to, turns } => {
                self.arc(wide(*via), wide(*to), Some(*turns))?
            }
            ArmCommand::Cp { .. } => self.cp(command, next)?,
            ArmCommand::Jog { is_joint, key: key @ 1..=8 } => self.jog(*is_joint, *key),
            ArmCommand::Wait(milliseconds) => ArmMotion::rest(f64::from(*milliseconds) * 1e-3),
            _ => return Ok(None),
        }))
    }

    fn ptp(&self, mode: PtpMode, target: [f64; 4]) -> Result<ArmMotion, Alarm> {
        let sum = |a: [f64; 4], b: [f64; 4]| std::array::from_fn(|axis| a[axis] + b[axis]);
        let target = match mode {
            PtpMode::JumpXyz
            | PtpMode::MoveJointXyz
            | PtpMode::MoveLineXyz
            | PtpMode::JumpLineXyz => ArmPoint::Xyzr(target),
            PtpMode::JumpAngle | PtpMode::MoveJointAngle | PtpMode::MoveLineAngle => {
                ArmPoint::Joints(target)
            }
            PtpMode::MoveJointIncrement => ArmPoint::Joints(sum(self.joints, target)),
            PtpMode::MoveLineIncrement | PtpMode::MoveJointXyzIncrement => {
                ArmPoint::Xyzr(sum(self.xyzr, target))
            }
        };
        let legs = match mode {
            PtpMode::JumpXyz | PtpMode::JumpAngle => self.jump(target, false)?,
            PtpMode::JumpLineXyz => self.jump(target, true)?,
            PtpMode::MoveLineXyz | PtpMode::MoveLineAngle | PtpMode::MoveLineIncrement => {
                vec![self.line(self.xyzr, self.xyzr_at(target))]
            }
            _ => vec![self.joint(self.joints, self.body.joints(target)?)],
        };
        ArmMotion::along(legs, self.body)
    }

    /// Up, over, down.
    fn jump(&self, target: ArmPoint, over_is_line: bool) -> Result<Vec<Leg>, Alarm> {
        let [height, limit] = self.registers.floats(id::PTP_JUMP);
        let end = self.xyzr_at(target);
        let top = (self.xyzr[2].max(end[2]) + height).min(limit);
        if top < self.xyzr[2] || top < end[2] {
            return Err(Alarm(0x15));
        }
        let at_top = |[x, y, _, r]: [f64; 4]| [x, y, top, r];
        let (first, second) = (at_top(self.xyzr), at_top(end));
        let over = if over_is_line {
            self.line(first, second)
        } else {
            let joints = |xyzr| self.body.joints(ArmPoint::Xyzr(xyzr));
            self.joint(joints(first)?, joints(second)?)
        };
        Ok(vec![self.line(self.xyzr, first), over, self.line(second, end)])
    }

    fn arc(&self, via: [f64; 4], to: [f64; 4], turns: Option<u32>) -> Result<ArmMotion, Alarm> {
        let path = LegPath::Arc(SimulatedArc::through(self.xyzr, via, to, turns)?);
        let speeds = match self.arc_speed {
            ArcSpeed::ArcParams => self.speeds(id::ARC_PARAMS, id::ARC_COMMON),
            ArcSpeed::PtpCoordinate => self.speeds(id::PTP_COORDINATE, id::PTP_COMMON),
        };
        ArmMotion::along(vec![speeds.leg(path)], self.body)
    }

    /// One continuous-path move, fast enough at its end for those behind it in the queue.
    fn cp(&self, command: &ArmCommand, next: &[ArmCommand]) -> Result<ArmMotion, Alarm> {
        let [planned, junction, actual] = self.registers.floats(id::CP_PARAMS);
        let acceleration = planned.min(actual);
        let mut here = self.xyzr;
        let mut ways = Vec::new();
        for move_ in std::iter::once(command).chain(next) {
            let Some(end) = cp_end(move_, here) else { break };
            ways.push((here, end));
            here = end;
        }
        // From the last known move backwards: each must be able to brake within its length.
        let mut exit = 0.0_f64;
        for pair in ways.windows(2).rev() {
            let length = LegPath::Line { from: pair[1].0, to: pair[1].1 }.length();
            let brakable = (exit * exit + 2.0 * acceleration * length).sqrt();
            exit = brakable.min(junction * straightness(pair[0], pair[1]));
        }
        let Some((from, to)) = ways.first().copied() else { return Ok(ArmMotion::default()) };
        let path = LegPath::Line { from, to };
        let length = path.length();
        let reachable = (self.entry_speed.powi(2) + 2.0 * acceleration * length).sqrt();
        let exit = exit.min(reachable);
        let profile = SpeedProfile::between(length, self.entry_speed, junction, exit, acceleration);
        ArmMotion::along(vec![Leg { path, profile }], self.body)
    }

    /// On in one direction as far as the limits let it; the next jog breaks it off.
    fn jog(&self, is_joint: bool, key: u8) -> ArmMotion {
        /// Looked at along the way, mm or deg.
        const STEP: f64 = 0.5;
        const N_STEPS: u32 = 1_000;
        let axis = usize::from(key - 1) / 2;
        let sign = if key % 2 == 1 { 1.0 } else { -1.0 };
        let from = if is_joint { self.joints } else { self.xyzr };
        let after = |n: u32| {
            let mut point = from;
            point[axis] += sign * STEP * f64::from(n);
            if is_joint { ArmPoint::Joints(point) } else { ArmPoint::Xyzr(point) }
        };
        let n_steps = (1..=N_STEPS).take_while(|n| self.body.joints(after(*n)).is_ok()).count();
        let register = if is_joint { id::JOG_JOINT } else { id::JOG_COORDINATE };
        let values = self.registers.floats::<8>(register);
        let [speed, acceleration] = ratios(self.registers.floats(id::JOG_COMMON));
        let profile = SpeedProfile::at_rest(
            STEP * n_steps as f64,
            values[axis] * speed,
            values[axis + 4] * acceleration,
        );
        let path = match after(n_steps as u32) {
            ArmPoint::Joints(to) => LegPath::Joint { from, to },
            ArmPoint::Xyzr(to) => LegPath::Line { from, to },
        };
        ArmMotion::unchecked(vec![Leg { path, profile }])
    }

    fn line(&self, from: [f64; 4], to: [f64; 4]) -> Leg {
        self.speeds(id::PTP_COORDINATE, id::PTP_COMMON).leg(LegPath::Line { from, to })
    }

    /// All joints arrive together; the slowest sets the pace.
    fn joint(&self, from: [f64; 4], to: [f64; 4]) -> Leg {
        let values = self.registers.floats::<8>(id::PTP_JOINT);
        let [speed, acceleration] = ratios(self.registers.floats(id::PTP_COMMON));
        let profiles = (0..4).map(|axis| {
            let way = (to[axis] - from[axis]).abs();
            SpeedProfile::at_rest(way, values[axis] * speed, values[axis + 4] * acceleration)
        });
        let profile = slowest(profiles);
        Leg { path: LegPath::Joint { from, to }, profile }
    }

    fn xyzr_at(&self, point: ArmPoint) -> [f64; 4] {
        match point {
            ArmPoint::Xyzr(xyzr) => xyzr,
            ArmPoint::Joints(joints) => super::kinematics::forward(joints, self.body.bias),
        }
    }

    fn speeds(&self, limits: u8, common: u8) -> PathSpeeds {
        let [xyz_speed, r_speed, xyz_acceleration, r_acceleration] = self.registers.floats(limits);
        let [speed, acceleration] = ratios(self.registers.floats(common));
        PathSpeeds {
            xyz: (xyz_speed * speed, xyz_acceleration * acceleration),
            r: (r_speed * speed, r_acceleration * acceleration),
        }
    }
}

impl PathSpeeds {
    /// The path at the pace of the slower of its length and its turn of r.
    fn leg(self, path: LegPath) -> Leg {
        let xyz = SpeedProfile::at_rest(path.length(), self.xyz.0, self.xyz.1);
        let r = SpeedProfile::at_rest(path.turn(), self.r.0, self.r.1);
        Leg { path, profile: slowest([xyz, r].into_iter()) }
    }
}

fn slowest(profiles: impl Iterator<Item = SpeedProfile>) -> SpeedProfile {
    profiles
        .max_by(|a, b| a.duration_s().total_cmp(&b.duration_s()))
        .unwrap_or_else(|| SpeedProfile::at_rest(0.0, 1.0, 1.0))
}

/// Percent to shares; more than 100 counts as 100.
fn ratios(percent: [f64; 2]) -> [f64; 2] {
    percent.map(|value| value.clamp(0.0, 100.0) / 100.0)
}

fn wide(values: [f32; 4]) -> [f64; 4] {
    values.map(f64::from)
}

/// Where a continuous-path move ends; `None` for any other command, which ends the blending.
fn cp_end(command: &ArmCommand, from: [f64; 4]) -> Option<[f64; 4]> {
    let ArmCommand::Cp { is_absolute, xyz, .. } = command else { return None };
    let mut to = from;
    for (axis, value) in xyz.iter().enumerate() {
        to[axis] = if *is_absolute { f64::from(*value) } else { from[axis] + f64::from(*value) };
    }
    Some(to)
}

/// 1 where two moves go the same way, 0 where they turn by 90 degrees or more.
fn straightness(first: ([f64; 4], [f64; 4]), second: ([f64; 4], [f64; 4])) -> f64 {
    let way = |(from, to): ([f64; 4], [f64; 4])| {
        nalgebra::Vector3::new(to[0] - from[0], to[1] - from[1], to[2] - from[2])
    };
    let (a, b) = (way(first), way(second));
    let lengths = a.norm() * b.norm();
    if lengths > 0.0 { (a.dot(&b) / lengths).max(0.0) } else { 1.0 }
}
