//! The state of the simulated arm and how it changes with time.

use super::dynamics::{self, ToolDynamics};
use super::kinematics;
use super::motion::{self, ArmGeometry, ArmMotion};
use super::options::{AlarmPolicy, ArmOptions};
use super::path::{self, ArmPoint};
use super::plan::Planner;
use super::profile::SpeedProfile;
use super::queue::{CommandQueue, QueueEntry, QueuedTask};
use super::registers::ArmRegisters;
use super::trace::ToolTrace;
use evrig_core::time::Span;
use evrig_device::dobot::alarm::{Alarm, Alarms};
use evrig_device::dobot::command::ArmCommand;
use evrig_device::dobot::id;
use evrig_session::rig::Pose;
use std::sync::Arc;

/// The joints the planner assumes after power-up, deg.
const POWER_UP_JOINTS: [f64; 4] = [0.0, 45.0, 45.0, 0.0];
/// Firmware version it gives.
pub(super) const VERSION: [u8; 3] = [3, 7, 0];

/// A motion under way.
#[derive(Debug, Clone)]
pub(super) struct RunningMotion {
    /// The command it belongs to; none for one that was not queued.
    index: Option<u64>,
    motion: ArmMotion,
    started: Span,
    is_homing: bool,
}

impl RunningMotion {
    fn ends(&self) -> Span {
        self.started + Span::from_secs_f64(self.motion.duration_s())
    }
}

/// The simulated arm.
#[derive(Debug, Clone)]
pub struct SimulatedArm {
    pub(super) options: ArmOptions,
    /// Time since power-up.
    pub(super) now: Span,
    pub(super) registers: ArmRegisters,
    pub(super) alarms: Alarms,
    pub(super) queue: CommandQueue,
    pub(super) running: Option<RunningMotion>,
    pub(super) joints: [f64; 4],
    /// Speed with which the last blended move ended, mm/s.
    pub(super) carried_speed: f64,
    pub(super) is_homed: bool,
    pub(super) truth: ToolDynamics,
    /// Up to when the truth was stepped.
    pub(super) truth_at: Span,
    /// Keeps the truth for those who look at it later.
    pub(super) trace: Option<Arc<ToolTrace>>,
}

impl SimulatedArm {
    /// An arm that has just been switched on.
    #[must_use]
    pub fn new(options: ArmOptions) -> Self {
        let registers = ArmRegisters::default();
        let xyzr = kinematics::forward(POWER_UP_JOINTS, registers.floats(id::END_EFFECTOR));
        Self {
            now: Span::ZERO,
            registers,
            alarms: Alarms::from_bytes(u128::from(!options.is_homed).to_le_bytes()),
            queue: CommandQueue::new(options.queue_depth, options.start_index),
            running: None,
            joints: POWER_UP_JOINTS,
            carried_speed: 0.0,
            is_homed: options.is_homed,
            truth: ToolDynamics::at_rest(POWER_UP_JOINTS[0], [xyzr[0], xyzr[1], xyzr[2]]),
            truth_at: Span::ZERO,
            trace: None,
            options,
        }
    }

    /// Time since power-up on the arm's clock.
    #[must_use]
    pub const fn now(&self) -> Span {
        self.now
    }

    /// Whether a motion (or a wait) is under way.
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        self.running.is_some()
    }

    /// Whether the arm was homed since power-up.
    #[must_use]
    pub const fn is_homed(&self) -> bool {
        self.is_homed
    }

    /// Commands that wait in the queue.
    #[must_use]
    pub fn n_waiting(&self) -> usize {
        self.queue.n_waiting()
    }

    /// The active alarms.
    #[must_use]
    pub const fn alarms(&self) -> Alarms {
        self.alarms
    }

    /// Pose of the tool by the planner.
    #[must_use]
    pub fn planner_pose(&self) -> Pose {
        Pose::from_mm_deg(self.xyzr())
    }

    /// True pose of the tool.
    #[must_use]
    pub fn true_pose(&self) -> Pose {
        Pose::from_mm_deg(self.true_xyzr(self.now))
    }

    /// Where the tool is when the true step is `at`.
    pub(super) fn true_xyzr(&self, at: Span) -> [f64; 4] {
        let offset_deg =
            if self.is_homed { 0.0 } else { self.options.imperfections.base_offset.value() };
        self.truth.pose(self.xyzr_at(at), self.joints_at(at)[0], offset_deg)
    }

    pub(super) fn bias(&self) -> [f64; 3] {
        self.registers.floats(id::END_EFFECTOR)
    }

    pub(super) fn body(&self) -> ArmGeometry<'_> {
        ArmGeometry { bias: self.bias(), limits: &self.options.limits }
    }

    pub(super) fn xyzr(&self) -> [f64; 4] {
        self.xyzr_at(self.now)
    }

    pub(super) fn xyzr_at(&self, at: Span) -> [f64; 4] {
        match self.point_at(at) {
            ArmPoint::Xyzr(xyzr) => xyzr,
            ArmPoint::Joints(joints) => kinematics::forward(joints, self.bias()),
        }
    }

    pub(super) fn joints_at(&self, at: Span) -> [f64; 4] {
        self.body().joints(self.point_at(at)).unwrap_or(self.joints)
    }

    pub(super) fn point_at(&self, at: Span) -> ArmPoint {
        self.running
            .as_ref()
            .and_then(|running| running.motion.at((at - running.started).as_secs_f64()))
            .unwrap_or(ArmPoint::Joints(self.joints))
    }

    /// Advances to `now` after power-up: motions end, queued commands start.
    pub fn advance(&mut self, now: Span) {
        while let Some(running) = &self.running {
            let ends = running.ends();
            if ends > now {
                break;
            }
            self.step_truth(ends);
            self.now = ends;
            self.end_motion();
            self.take_turns();
        }
        if now > self.now {
            self.step_truth(now);
            self.now = now;
        }
    }

    pub(super) fn step_truth(&mut self, until: Span) {
        let step = Span::from_secs_f64(dynamics::STEP_S);
        while self.truth_at + step <= until {
            if self.running.is_none() && self.truth.is_calm() {
                // Nothing moves: the rest of the time can be passed over on the same grid.
                let n_steps = (until - self.truth_at).as_nanos() / step.as_nanos();
                self.note_truth();
                self.truth_at = self.truth_at + Span::from_nanos(step.as_nanos() * n_steps);
                self.note_truth();
                break;
            }
            self.truth_at = self.truth_at + step;
            let [x, y, z, _] = self.xyzr_at(self.truth_at);
            let base_deg = self.joints_at(self.truth_at)[0];
            self.truth.step(&self.options.imperfections, base_deg, [x, y, z]);
            self.note_truth();
        }
    }

    /// The running motion is over, by its end or by an alarm on the way.
    pub(super) fn end_motion(&mut self) {
        self.joints = self.joints_at(self.now);
        let Some(running) = self.running.take() else { return };
        self.carried_speed = running.motion.exit_speed();
        if let Some(alarm) = running.motion.breaks_with() {
            self.raise(alarm);
        } else if running.is_homing {
            self.is_homed = true;
        }
        if let Some(index) = running.index
            && (running.motion.breaks_with().is_none()
                || self.options.on_alarm == AlarmPolicy::Skip)
        {
            self.queue.finish(index);
        }
    }

    /// Breaks the running motion off where it is.
    pub(super) fn break_off(&mut self) {
        self.joints = self.joints_at(self.now);
        self.running = None;
        self.carried_speed = 0.0;
    }

    /// Raises an alarm; motion ends at once.
    pub fn raise(&mut self, alarm: Alarm) {
        self.alarms.raise(alarm.0);
        self.break_off();
    }

    /// Starts what is next in the queue until something takes time.
    pub(super) fn take_turns(&mut self) {
        while self.running.is_none() && !self.is_stalled() {
            let Some(QueueEntry { index, task }) = self.queue.pop() else { return };
            match task {
                QueuedTask::Set { id, params } => {
                    self.write(id, &params);
                    self.queue.finish(index);
                }
                QueuedTask::Do(command) => self.begin(&command, Some(index)),
            }
        }
    }

    pub(super) fn is_stalled(&self) -> bool {
        self.options.on_alarm == AlarmPolicy::Stall && self.alarms.has_fault()
    }

    /// Begins a command that takes time; raises the alarm when it cannot be planned.
    pub(super) fn begin(&mut self, command: &ArmCommand, index: Option<u64>) {
        let next: Vec<ArmCommand> = self.queue.commands().collect();
        let planner = Planner {
            body: self.body(),
            registers: &self.registers,
            arc_speed: self.options.arc_speed,
            joints: self.joints,
            xyzr: self.xyzr(),
            entry_speed: self.carried_speed,
        };
        let is_homing = *command == ArmCommand::Home;
        let planned =
            if is_homing { Ok(Some(self.homing(&planner))) } else { planner.plan(command, &next) };
        match planned {
            Ok(motion) => {
                let motion = motion.unwrap_or_default();
                self.running = Some(RunningMotion { index, motion, started: self.now, is_homing });
            }
            Err(alarm) => {
                self.raise(alarm);
                if let (AlarmPolicy::Skip, Some(index)) = (self.options.on_alarm, index) {
                    self.queue.finish(index);
                }
            }
        }
    }

    /// The base sweeps to find its mark, then the arm goes to the homing pose.
    pub(super) fn homing(&self, planner: &Planner<'_>) -> ArmMotion {
        let home = ArmPoint::Xyzr(self.registers.floats(id::HOME_PARAMS));
        let end = planner.body.joints(home).unwrap_or(POWER_UP_JOINTS);
        let sweep = |by: f64| [self.joints[0] + by, self.joints[1], self.joints[2], self.joints[3]];
        let way = [self.joints, sweep(20.0), sweep(-20.0), end];
        let length = |pair: &[[f64; 4]]| {
            (0..4).map(|axis| (pair[1][axis] - pair[0][axis]).abs()).fold(0.0, f64::max)
        };
        let total: f64 = way.windows(2).map(length).sum();
        let legs = way.windows(2).map(|pair| {
            let share_s = (self.options.homing.as_secs_f64() * length(pair) / total).max(1e-3);
            // A trapezoid that is all ramp takes 2 * sqrt(length / acceleration).
            let acceleration = 4.0 * length(pair) / (share_s * share_s);
            let profile = SpeedProfile::at_rest(length(pair), f64::INFINITY, acceleration);
            motion::Leg { path: path::LegPath::Joint { from: pair[0], to: pair[1] }, profile }
        });
        // The sweep ends at the base's own switch, so limits do not break it off.
        ArmMotion::unchecked(legs.collect())
    }
}

impl SimulatedArm {
    /// Records the true trajectory from now on.
    pub fn keep_trace(&mut self) -> Arc<ToolTrace> {
        let trace = Arc::clone(self.trace.get_or_insert_default());
        trace.note(self.truth_at, self.true_xyzr(self.truth_at));
        trace
    }

    pub(super) fn note_truth(&self) {
        if let Some(trace) = &self.trace {
            trace.note(self.truth_at, self.true_xyzr(self.truth_at));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::options::ArcSpeed;
    use evrig_device::dobot::command::{CartesianLimits, CpLimits, PtpMode, Ratios, XyzR};
    use evrig_device::dobot::frame::{ArmFrame, Ctrl};
    use evrig_device::dobot::reply;

    fn ms(milliseconds: i64) -> Span {
        Span::from_micros(milliseconds * 1_000)
    }

    /// An arm at the paper's start pose with its queue running.
    fn at_start(options: ArmOptions) -> SimulatedArm {
        let mut arm = SimulatedArm::new(options);
        for command in [ArmCommand::ClearAlarms, ArmCommand::StartQueue] {
            assert!(arm.answer(&command.frame(Ctrl::WRITE), arm.now()).is_some());
        }
        let target = START;
        queue(&mut arm, ArmCommand::Ptp { mode: PtpMode::MoveJointXyz, target });
        arm.advance(ms(20_000));
        assert!(!arm.is_busy());
        arm
    }

    const START: XyzR = [240.0, 0.0, 100.0, 90.0];
    const CIRCLE: ArmCommand = ArmCommand::Circle {
        via: [252.0, 12.0, 100.0, 90.0],
        to: [264.0, 0.0, 100.0, 90.0],
        turns: 1,
    };

    fn queue(arm: &mut SimulatedArm, command: ArmCommand) -> Option<u64> {
        let reply = arm.answer(&command.frame(Ctrl::QUEUED), arm.now()).unwrap();
        reply::queued_index(&reply).unwrap()
    }

    fn finished(arm: &mut SimulatedArm) -> u64 {
        let request = evrig_device::dobot::command::read(id::QUEUE_INDEX);
        reply::index(&arm.answer(&request, arm.now()).unwrap()).unwrap()
    }

    /// Steps until nothing moves: how long it took, and the planner's poses every 5 ms.
    fn run(arm: &mut SimulatedArm) -> (Span, Vec<[f64; 4]>) {
        let start = arm.now();
        let mut poses = Vec::new();
        let mut end = start;
        while arm.is_busy() {
            poses.push(arm.planner_pose().to_mm_deg());
            end = arm.running.as_ref().map_or(end, RunningMotion::ends);
            arm.advance(arm.now() + ms(5));
            assert!(poses.len() < 100_000, "it never ends");
        }
        (end - start, poses)
    }

    #[test]
    fn the_papers_circle_is_driven_in_its_ideal_time() {
        let mut arm = at_start(ArmOptions::default());
        let limits = CartesianLimits::uniform(50.0, 50.0);
        arm.answer(&ArmCommand::ArcParams(limits).frame(Ctrl::WRITE), arm.now());
        let index = queue(&mut arm, CIRCLE).unwrap();
        let (took, poses) = run(&mut arm);
        assert!((took.as_secs_f64() - 2.508).abs() < 1e-3, "{took}");
        assert!(poses.iter().all(|p| ((p[0] - 252.0).hypot(p[1]) - 12.0).abs() < 1e-6));
        assert!(poses.iter().any(|p| p[1] > 11.0) && poses.iter().any(|p| p[1] < -11.0));
        assert_eq!(finished(&mut arm), index);
        assert!((arm.planner_pose().to_mm_deg()[0] - 240.0).abs() < 1e-6, "back at its start");
    }

    #[test]
    fn the_other_reading_of_the_documents_takes_the_speed_from_ptp() {
        let options = ArmOptions { arc_speed: ArcSpeed::PtpCoordinate, ..ArmOptions::default() };
        let mut arm = at_start(options);
        let ratios = Ratios { velocity: 15.0, acceleration: 15.0 };
        arm.answer(&ArmCommand::PtpCommon(ratios).frame(Ctrl::WRITE), arm.now());
        queue(&mut arm, CIRCLE);
        let (took, _) = run(&mut arm);
        let length = std::f64::consts::TAU * 12.0;
        // 300 mm/s and 400 mm/s^2 at 15 %: 45 and 60.
        assert!((took.as_secs_f64() - (length / 45.0 + 45.0 / 60.0)).abs() < 1e-3, "{took}");
    }

    #[test]
    fn an_arm_that_was_switched_on_states_it_and_moves_only_when_commanded() {
        let mut arm = SimulatedArm::new(ArmOptions::default());
        assert!(arm.alarms().is_fresh_from_power_up() && !arm.alarms().has_fault());
        queue(&mut arm, ArmCommand::Wait(10));
        arm.advance(ms(1_000));
        assert_eq!(arm.n_waiting(), 1, "the queue is not started");
        arm.answer(&ArmCommand::StartQueue.frame(Ctrl::WRITE), arm.now());
        arm.advance(ms(2_000));
        assert_eq!((arm.n_waiting(), finished(&mut arm)), (0, 1));
    }

    #[test]
    fn a_full_queue_answers_with_nothing_and_keeps_its_commands() {
        let mut arm = SimulatedArm::new(ArmOptions { queue_depth: 3, ..ArmOptions::default() });
        let indexes: Vec<_> = (0..4).map(|_| queue(&mut arm, ArmCommand::Wait(1))).collect();
        assert_eq!(indexes, [Some(1), Some(2), Some(3), None]);
        let space = arm.answer(&evrig_device::dobot::command::read(id::QUEUE_SPACE), arm.now());
        assert_eq!(reply::queue_space(&space.unwrap()), Ok(0));
    }

    #[test]
    fn force_stop_freezes_the_arm_where_it_is() {
        let mut arm = at_start(ArmOptions::default());
        let index = queue(&mut arm, CIRCLE).unwrap();
        arm.advance(arm.now() + ms(400));
        let here = arm.planner_pose();
        arm.answer(&ArmCommand::ForceStop.frame(Ctrl::WRITE), arm.now());
        arm.advance(arm.now() + ms(5_000));
        assert!(!arm.is_busy());
        assert!(here.distance(arm.planner_pose()).value() < 1e-6);
        assert!(finished(&mut arm) < index, "a broken-off command never finishes");
    }

    #[test]
    fn stopping_the_queue_ends_behind_the_current_command() {
        let mut arm = at_start(ArmOptions::default());
        queue(&mut arm, CIRCLE);
        queue(&mut arm, ArmCommand::Wait(1));
        arm.answer(&ArmCommand::StopQueue.frame(Ctrl::WRITE), arm.now());
        assert!(arm.is_busy());
        arm.advance(arm.now() + ms(10_000));
        assert_eq!((arm.is_busy(), arm.n_waiting()), (false, 1));
    }

    #[test]
    fn a_target_out_of_reach_raises_its_alarm_and_holds_the_queue() {
        let mut arm = at_start(ArmOptions::default());
        let before = arm.planner_pose();
        let mode = PtpMode::MoveLineXyz;
        let index = queue(&mut arm, ArmCommand::Ptp { mode, target: [500.0, 0.0, 0.0, 0.0] });
        queue(&mut arm, CIRCLE);
        arm.advance(arm.now() + ms(5_000));
        assert_eq!(arm.alarms().faults().collect::<Vec<_>>(), [Alarm::PLAN_OUT_OF_REACH]);
        assert_eq!(arm.n_waiting(), 1);
        assert!(before.distance(arm.planner_pose()).value() < 1e-6);
        arm.answer(&ArmCommand::ClearAlarms.frame(Ctrl::WRITE), arm.now());
        arm.advance(arm.now() + ms(5_000));
        assert_eq!(arm.n_waiting(), 0);
        assert!(finished(&mut arm) > index.unwrap());
    }

    #[test]
    fn a_line_through_the_limits_breaks_off_on_its_way() {
        let mut arm = at_start(ArmOptions::default());
        let mode = PtpMode::MoveJointXyz;
        queue(&mut arm, ArmCommand::Ptp { mode, target: [0.0, 240.0, 100.0, 90.0] });
        arm.advance(arm.now() + ms(20_000));
        // The straight way to the other side leads past the base axis.
        let mode = PtpMode::MoveLineXyz;
        queue(&mut arm, ArmCommand::Ptp { mode, target: [0.0, -240.0, 100.0, 0.0] });
        arm.advance(arm.now() + ms(20_000));
        let faults: Vec<_> = arm.alarms().faults().collect();
        assert!(faults.len() == 1 && faults[0].0 & 0xf0 == 0x20, "{faults:?}");
        let y = arm.planner_pose().to_mm_deg()[1];
        assert!(y < 240.0 && y > 50.0, "it stops on its way: {y}");
    }

    #[test]
    fn consecutive_continuous_moves_blend_and_ptp_moves_do_not() {
        let cp = CpLimits {
            plan_acceleration: 200.0,
            junction_velocity: 40.0,
            acceleration: 200.0,
            is_real_time: false,
        };
        let drive = |commands: &[ArmCommand]| {
            let mut arm = at_start(ArmOptions::default());
            arm.answer(&ArmCommand::CpParams(cp).frame(Ctrl::WRITE), arm.now());
            let limits = CartesianLimits::uniform(40.0, 200.0);
            arm.answer(&ArmCommand::PtpCoordinate(limits).frame(Ctrl::WRITE), arm.now());
            let full = Ratios { velocity: 100.0, acceleration: 100.0 };
            arm.answer(&ArmCommand::PtpCommon(full).frame(Ctrl::WRITE), arm.now());
            arm.answer(&ArmCommand::StopQueue.frame(Ctrl::WRITE), arm.now());
            for command in commands {
                queue(&mut arm, *command);
            }
            arm.answer(&ArmCommand::StartQueue.frame(Ctrl::WRITE), arm.now());
            run(&mut arm).0.as_secs_f64()
        };
        let places: Vec<[f32; 3]> = (1..=10).map(|n| [240.0, n as f32 * 3.0, 100.0]).collect();
        let blended: Vec<_> = places
            .iter()
            .map(|xyz| ArmCommand::Cp { is_absolute: true, xyz: *xyz, velocity: 0.0 })
            .collect();
        let single: Vec<_> = places
            .iter()
            .map(|p| ArmCommand::Ptp {
                mode: PtpMode::MoveLineXyz,
                target: [p[0], p[1], p[2], 90.0],
            })
            .collect();
        // 30 mm at 40 mm/s with one ramp up and one down, against ten of each.
        assert!((drive(&blended) - (30.0 / 40.0 + 40.0 / 200.0)).abs() < 1e-3);
        assert!((drive(&single) - 10.0 * 2.0 * (3.0_f64 / 200.0).sqrt()).abs() < 1e-3);
    }

    #[test]
    fn homing_takes_its_time_and_ends_at_the_homing_pose() {
        let mut options = ArmOptions::default();
        options.imperfections.base_offset.0 = 3.0;
        let mut arm = SimulatedArm::new(options);
        let error = |arm: &SimulatedArm| arm.true_pose().distance(arm.planner_pose()).value();
        assert!(error(&arm) > 10.0, "before homing the planner is wrong about the base");
        arm.answer(&ArmCommand::HomeParams([200.0, 0.0, 50.0, 0.0]).frame(Ctrl::WRITE), arm.now());
        arm.answer(&ArmCommand::StartQueue.frame(Ctrl::WRITE), arm.now());
        queue(&mut arm, ArmCommand::Home);
        let (took, _) = run(&mut arm);
        assert!((took.as_secs_f64() - 15.0).abs() < 0.01, "{took}");
        assert!(arm.is_homed() && error(&arm) < 1e-6);
        let [x, _, z, _] = arm.planner_pose().to_mm_deg();
        assert!((x - 200.0).abs() < 1e-3 && (z - 50.0).abs() < 1e-3);
    }

    #[test]
    fn a_jog_goes_on_until_it_is_ended_or_at_its_limit() {
        let mut arm = at_start(ArmOptions::default());
        let set = |arm: &mut SimulatedArm, key| {
            let jog = ArmCommand::Jog { is_joint: true, key };
            arm.answer(&jog.frame(Ctrl::WRITE), arm.now());
        };
        let base = arm.joints[0];
        set(&mut arm, 1);
        arm.advance(arm.now() + ms(2_000));
        set(&mut arm, 0);
        // 15 deg/s and 60 deg/s^2 at 50 %: a ramp of 0.25 s, then 7.5 deg/s.
        let turned = arm.joints[0] - base;
        assert!((turned - 7.5 * (2.0 - 0.125)).abs() < 1e-6, "{turned}");
        arm.advance(arm.now() + ms(2_000));
        assert!((arm.joints[0] - base - turned).abs() < 1e-9);
        set(&mut arm, 1);
        arm.advance(arm.now() + ms(60_000));
        assert!((arm.joints[0] - 125.0).abs() <= 0.5, "{}", arm.joints[0]);
    }

    #[test]
    fn an_unknown_circle_is_met_with_silence() {
        let mut arm = at_start(ArmOptions { has_circle: false, ..ArmOptions::default() });
        assert_eq!(arm.answer(&CIRCLE.frame(Ctrl::QUEUED), arm.now()), None);
        assert_eq!(arm.answer(&ArmFrame::bare(200, Ctrl::READ), arm.now()), None);
    }

    #[test]
    fn the_true_pose_swings_around_the_planners() {
        let mut options = ArmOptions::default();
        options.imperfections.vibration_gain = 2e-4;
        let mut arm = at_start(options);
        queue(&mut arm, CIRCLE);
        let mut largest = 0.0_f64;
        while arm.is_busy() {
            arm.advance(arm.now() + ms(5));
            largest = largest.max(arm.true_pose().distance(arm.planner_pose()).value());
        }
        // 100 mm/s^2 of ramp and up to 100^2 / 12 mm/s^2 towards the centre, at 2e-4 mm each.
        assert!(largest > 0.02 && largest < 2.0, "{largest} mm");
    }
}
