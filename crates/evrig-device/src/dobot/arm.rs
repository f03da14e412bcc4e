//! The Magician as an [`Arm`]: paths in, motion and poses out.

use super::check;
use super::client::{ArmClient, ArmClientError, Identity};
use super::command::ArmCommand;
use super::guard::{GuardLink, GuardStop};
use super::link::LinkError;
use super::port::PortError;
use super::steps::{self, CircleAs};
use evrig_core::time::{HostMonotonic, Span, Stamp};
use evrig_record::{Arm, DeviceError, Finding, Progress, host_clock};
use evrig_session::rig::{ArmDescription, Pose};
use evrig_session::trajectory::{Margin, ToolPath};
use std::collections::VecDeque;
use std::ops::Range;

/// Why the arm cannot drive.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArmError {
    /// Its port cannot be used.
    #[error(transparent)]
    Port(#[from] PortError),
    /// It does not answer, has an alarm, or does not obey a command.
    #[error(transparent)]
    Client(#[from] ArmClientError),
    /// The path leaves what the arm may do.
    #[error("the arm may not drive this path: {0}")]
    BeyondLimit(Box<Margin>),
    /// Steps were started that were not prepared.
    #[error(
        "steps {}..{} were started, the prepared path has {n_steps}; prepare the path first",
        steps.start, steps.end
    )]
    NotPrepared {
        /// What was started.
        steps: Range<usize>,
        /// What there is.
        n_steps: usize,
    },
    /// The tool is not where a motion begins.
    #[error("the arm is at {found}, the step begins at {expected}; prepare the path again")]
    NotAtStart {
        /// Its pose.
        found: Pose,
        /// The pose expected.
        expected: Pose,
    },
}

impl From<LinkError> for ArmError {
    fn from(error: LinkError) -> Self {
        Self::Client(error.into())
    }
}

/// A digital output that goes high while a step is under way: an edge that a camera or a counter
/// can see. (The DAVIS driver in use does not read the camera's trigger input, so the edge
/// must reach it as light.)
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Marker {
    /// Pin 1..=20.
    pub address: u8,
}

/// The Magician.
#[derive(Debug)]
pub struct Magician {
    pub(super) client: ArmClient,
    stopper: Option<GuardStop>,
    pub(super) description: ArmDescription,
    pub(super) marker: Option<Marker>,
    pub(super) circle: CircleAs,
    pub(super) path: Option<ToolPath>,
    run: Option<QueuedSteps>,
}

/// Steps under way.
#[derive(Debug)]
struct QueuedSteps {
    /// What still has to go into the queue, with its step.
    waiting: VecDeque<(ArmCommand, usize)>,
    /// Last queued index of each step that is wholly queued.
    ends: Vec<(usize, u64)>,
    started: Stamp<HostMonotonic>,
    deadline: Span,
    /// Whether the queue was started.
    is_going: bool,
    /// How often the queue was found empty between continuous moves.
    n_dry: u32,
    /// Polls so far.
    n_polls: u32,
}

/// Commands queued between two polls: at some 5 ms each they leave time for 20 polls a second.
const MAX_QUEUED_PER_POLL: usize = 6;
/// Alarms are read at every so many polls; an alarm stops the arm by itself.
const POLLS_PER_ALARM_CHECK: u32 = 4;
/// How long a full queue is waited for while preparing.
pub(super) const QUEUE_TIMEOUT: Span = Span::from_micros(5_000_000);
/// The arm's repeatability is 0.2 mm; its planner is exact.
const AT_START_MM: f64 = 0.5;

impl Magician {
    /// Speaks to the arm through a guard process started from `program` (this program, normally).
    ///
    /// # Errors
    /// When the guard does not start or the port cannot be opened.
    pub fn guarded(
        program: &std::path::Path,
        port: &std::path::Path,
        description: ArmDescription,
        patience: super::ArmTimeouts,
    ) -> Result<Self, ArmError> {
        let link = GuardLink::start(program, port)?;
        let stopper = link.stopper();
        let mut arm = Self::over(ArmClient::new(Box::new(link), patience), description);
        arm.stopper = stopper;
        Ok(arm)
    }

    /// Speaks over any client; without a guard nothing stops the arm when this process dies.
    #[must_use]
    pub fn over(client: ArmClient, description: ArmDescription) -> Self {
        Self {
            client,
            stopper: None,
            description,
            marker: None,
            circle: CircleAs::Circle,
            path: None,
            run: None,
        }
    }

    /// Marks steps by an output.
    #[must_use]
    pub const fn with_marker(mut self, marker: Marker) -> Self {
        self.marker = Some(marker);
        self
    }

    /// What halts the arm from other threads; none without a guard.
    #[must_use]
    pub fn stopper(&self) -> Option<GuardStop> {
        self.stopper.clone()
    }

    /// Who it is.
    ///
    /// # Errors
    /// No answer.
    pub fn identify(&mut self) -> Result<Identity, ArmError> {
        Ok(self.client.identify()?)
    }

    /// Homes the arm at the pose of its description. Its base sweeps: clear the table.
    ///
    /// # Errors
    /// Alarms, silence, or `deadline` passed.
    pub fn home(&mut self, deadline: Span) -> Result<(), ArmError> {
        self.client.clear_alarms()?;
        Ok(self.client.home(self.description.home, deadline)?)
    }

    /// The client, for what is no part of a path.
    pub const fn client(&mut self) -> &mut ArmClient {
        &mut self.client
    }

    /// Fills the queue, [`MAX_QUEUED_PER_POLL`] commands at most, so that a long path does not
    /// delay the next poll. Returns how many were queued.
    fn feed(&mut self) -> Result<usize, ArmError> {
        let Some(run) = &mut self.run else { return Ok(0) };
        let mut n_fed = 0;
        let mut has_asked = false;
        while let Some((command, step)) = run.waiting.front().copied()
            && n_fed < MAX_QUEUED_PER_POLL
        {
            if !self.client.knows_of_room() {
                if has_asked || !self.client.has_room()? {
                    break;
                }
                has_asked = true;
                let is_continuous = matches!(command, ArmCommand::Cp { .. });
                run.n_dry += u32::from(run.is_going && is_continuous && self.client.is_empty());
            }
            let index = self.client.enqueue(&command, QUEUE_TIMEOUT)?;
            run.waiting.pop_front();
            n_fed += 1;
            if run.waiting.front().is_none_or(|(_, next)| *next != step) {
                run.ends.push((step, index));
            }
        }
        Ok(n_fed)
    }

    fn start_steps(&mut self, steps: Range<usize>) -> Result<(), ArmError> {
        let path = self.path.as_ref();
        let n_steps = path.map_or(0, |path| path.steps().len());
        let chosen = path.and_then(|path| path.steps().get(steps.clone()));
        let Some(chosen) = chosen.filter(|chosen| !chosen.is_empty()) else {
            return Err(ArmError::NotPrepared { steps, n_steps });
        };
        let expected = chosen[0].curve.from();
        let mut waiting = VecDeque::new();
        let mut duration = Span::ZERO;
        for (step, number) in chosen.iter().zip(steps) {
            duration = duration + step.duration;
            let edge = |is_high| {
                self.marker.map(|Marker { address }| ArmCommand::Output { address, is_high })
            };
            let motion = steps::commands(step, self.circle);
            let commands = edge(true).into_iter().chain(motion).chain(edge(false));
            waiting.extend(commands.map(|command| (command, number)));
        }
        let found = self.client.pose()?.pose;
        if found.distance(expected).0 > AT_START_MM {
            return Err(ArmError::NotAtStart { found, expected });
        }
        // The queue is filled while it is stopped, so that continuous moves can look ahead.
        self.client.stop()?;
        let deadline = duration + duration + QUEUE_TIMEOUT + QUEUE_TIMEOUT;
        let started = host_clock::now();
        self.run = Some(QueuedSteps {
            waiting,
            ends: Vec::new(),
            started,
            deadline,
            is_going: false,
            n_dry: 0,
            n_polls: 0,
        });
        while self.feed()? > 0 {}
        self.client.set(&ArmCommand::StartQueue)?;
        if let Some(run) = &mut self.run {
            run.is_going = true;
        }
        Ok(())
    }

    fn look(&mut self) -> Result<Progress, ArmError> {
        let pose = self.client.pose()?;
        let current = self.client.finished_index()?;
        let n_polls = self.run.as_ref().map_or(0, |run| run.n_polls);
        if n_polls.is_multiple_of(POLLS_PER_ALARM_CHECK) {
            self.client.refuse_alarms()?;
        }
        self.feed()?;
        let Some(run) = &mut self.run else {
            return Ok(Progress { pose, step: 0, is_done: true, n_dry: 0 });
        };
        run.n_polls += 1;
        let n_dry = run.n_dry;
        let under_way = run.ends.iter().find(|(_, end)| !super::client::has_reached(current, *end));
        let last = run.ends.last().map_or(0, |(step, _)| *step);
        let next = run.waiting.front().map(|(_, step)| *step);
        let step = under_way.map(|(step, _)| *step).or(next);
        let waited = host_clock::now() - run.started;
        if let (Some(_), true) = (step, waited > run.deadline) {
            let index = under_way.map_or(current, |(_, end)| *end);
            return Err(ArmClientError::Late { index, current, waited }.into());
        }
        Ok(Progress { pose, step: step.unwrap_or(last), is_done: step.is_none(), n_dry })
    }

    /// Passes a result on; after an error the arm is stopped first.
    fn or_stop<T>(&mut self, result: Result<T, ArmError>) -> Result<T, ArmError> {
        if result.is_err() {
            self.run = None;
            // The first error is the one to report; the guard stops the arm again at the end.
            let _ = self.client.stop();
        }
        result
    }
}

// The verbs of [`Arm`], with this driver's own errors.
impl Magician {
    /// As [`Arm::prepare`].
    ///
    /// # Errors
    /// Whatever keeps the arm from its start; the arm is stopped before.
    pub fn prepare(&mut self, path: &ToolPath) -> Result<Vec<String>, ArmError> {
        let prepared = self.prepare_path(path);
        self.or_stop(prepared)
    }

    /// As [`Arm::start`].
    ///
    /// # Errors
    /// Whatever keeps the arm from moving; the arm is stopped before.
    pub fn start(&mut self, steps: Range<usize>) -> Result<(), ArmError> {
        let started = self.start_steps(steps);
        self.or_stop(started)
    }

    /// As [`Arm::progress`].
    ///
    /// # Errors
    /// An alarm, silence, a motion that does not end in time; the arm is stopped before.
    pub fn progress(&mut self) -> Result<Progress, ArmError> {
        let progress = self.look();
        self.or_stop(progress)
    }

    /// As [`Arm::abort`].
    ///
    /// # Errors
    /// When the arm did not confirm.
    pub fn abort(&mut self) -> Result<(), ArmError> {
        self.run = None;
        Ok(self.client.stop()?)
    }
}

impl From<ArmError> for DeviceError {
    fn from(error: ArmError) -> Self {
        Self::new(error)
    }
}

impl Arm for Magician {
    fn check(&mut self, path: Option<&ToolPath>) -> Vec<Finding> {
        check::findings(&mut self.client, &self.description, path)
    }

    fn prepare(&mut self, path: &ToolPath) -> Result<Vec<String>, DeviceError> {
        Ok(self.prepare(path)?)
    }

    fn start(&mut self, steps: Range<usize>) -> Result<(), DeviceError> {
        Ok(self.start(steps)?)
    }

    fn progress(&mut self) -> Result<Progress, DeviceError> {
        Ok(self.progress()?)
    }

    fn finish(&mut self) -> Result<(), DeviceError> {
        Ok(self.abort()?)
    }

    fn abort(&mut self) -> Result<(), DeviceError> {
        Ok(self.abort()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dobot::{ArmTimeouts, id, port};
    use evrig_core::units::{
        DegreesPerSecond, DegreesPerSecond2, MillimetresPerSecond, MillimetresPerSecond2,
    };
    use evrig_record::Verdict;
    use evrig_session::rig::Rig;
    use evrig_session::trajectory::{Rates, StepSettings, ToolCurve};
    use evrig_sim::arm::fault::{Fault, FaultKind};
    use evrig_sim::arm::{ArmClock, ArmEmulator, ArmOptions};

    /// The arm's time passes by requests, so nothing here waits for real motion.
    fn emulator(options: ArmOptions) -> ArmEmulator {
        ArmEmulator::start(options, ArmClock::Stepped(Span::from_micros(4_000)), Vec::new())
            .unwrap()
    }

    fn magician(emulator: &ArmEmulator) -> Magician {
        let patience = ArmTimeouts {
            reply: Span::from_micros(300_000),
            n_tries: 3,
            between_polls: Span::ZERO,
        };
        let link = port::open(emulator.port()).unwrap();
        let client = ArmClient::new(Box::new(link), patience);
        Magician::over(client, Rig::simulated().unwrap().arm)
    }

    fn homed(emulator: &ArmEmulator) -> Magician {
        let mut arm = magician(emulator);
        arm.home(Span::from_micros(20_000_000)).unwrap();
        assert!(emulator.state().is_homed);
        arm
    }

    fn rates(speed: f64) -> Rates {
        Rates {
            speed: MillimetresPerSecond(speed),
            acceleration: MillimetresPerSecond2(200.0),
            turn_speed: DegreesPerSecond(60.0),
            turn_acceleration: DegreesPerSecond2(200.0),
        }
    }

    /// Dwell, circle, dwell.
    fn path() -> ToolPath {
        let [a, b, c] = [[240.0, 0.0], [252.0, 12.0], [264.0, 0.0]]
            .map(|[x, y]| Pose::from_mm_deg([x, y, 100.0, 90.0]));
        let mut path = ToolPath::new(a);
        let rest = Span::from_micros(200_000);
        path.push_hold("before", 0, rest, rates(60.0), StepSettings::default());
        let circle = ToolCurve::circle(a, b, c, 2).unwrap();
        path.push("circle", 1, circle, rates(60.0), StepSettings::default());
        path.push_hold("after", 2, rest, rates(60.0), StepSettings::default());
        path
    }

    fn drive(arm: &mut Magician, steps: Range<usize>) -> Result<Vec<Progress>, ArmError> {
        arm.start(steps)?;
        let mut seen = Vec::new();
        loop {
            let progress = arm.progress()?;
            seen.push(progress);
            if progress.is_done {
                return Ok(seen);
            }
            assert!(seen.len() < 20_000, "it never ends");
        }
    }

    #[test]
    fn a_path_is_driven_step_by_step_along_its_curve() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        let path = path();
        assert!(arm.prepare(&path).unwrap().is_empty());
        let seen = drive(&mut arm, 0..3).unwrap();
        arm.finish().unwrap();
        let steps: Vec<usize> = seen.iter().map(|progress| progress.step).collect();
        assert!(steps.is_sorted() && steps.contains(&0) && steps.contains(&1), "{steps:?}");
        for progress in &seen {
            let [x, y, z, r] = progress.pose.pose.to_mm_deg();
            assert!(((x - 252.0).hypot(y) - 12.0).abs() < 1e-3, "{:?}", progress.pose);
            assert!((z - 100.0).abs() < 1e-3 && (r - 90.0).abs() < 1e-3);
            assert!(progress.pose.answered >= progress.pose.asked);
        }
        // One circle command, not two half arcs.
        let n_circles = emulator.journal().iter().filter(|line| line.name == "CIRCLE").count();
        assert_eq!(n_circles, 2, "one to see whether it is known, one to drive");
    }

    #[test]
    fn a_firmware_without_circles_drives_arcs_and_states_it() {
        let emulator = emulator(ArmOptions { has_circle: false, ..ArmOptions::default() });
        let mut arm = homed(&emulator);
        let path = path();
        let remarks = arm.prepare(&path).unwrap();
        assert!(remarks.len() == 1 && remarks[0].contains("two arcs"), "{remarks:?}");
        let seen = drive(&mut arm, 0..3).unwrap();
        let mut sides = [false; 2];
        for progress in &seen {
            let [x, y, ..] = progress.pose.pose.to_mm_deg();
            assert!(((x - 252.0).hypot(y) - 12.0).abs() < 1e-3);
            sides = [sides[0] || y > 11.0, sides[1] || y < -11.0];
        }
        assert_eq!(sides, [true; 2], "both half circles are driven");
    }

    #[test]
    fn a_path_longer_than_the_queue_is_fed_as_space_becomes_free() {
        let emulator = emulator(ArmOptions { queue_depth: 4, ..ArmOptions::default() });
        let mut arm = homed(&emulator);
        let poses: Vec<Pose> =
            (0..=40).map(|n| Pose::from_mm_deg([240.0, f64::from(n), 100.0, 90.0])).collect();
        let mut path = ToolPath::new(poses[0]);
        let end = poses[40];
        path.push(
            "points",
            0,
            ToolCurve::points(poses).unwrap(),
            rates(40.0),
            StepSettings::default(),
        );
        arm.prepare(&path).unwrap();
        drive(&mut arm, 0..1).unwrap();
        assert!(emulator.state().planner.distance(end).0 < 1e-3);
        let n_moves = emulator.journal().iter().filter(|line| line.name == "CP").count();
        assert_eq!(n_moves, 40, "each point is sent once");
    }

    #[test]
    fn an_arm_that_was_not_homed_is_not_moved() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = magician(&emulator);
        let homed = arm.check(None).into_iter().find(|finding| finding.subject == "homed").unwrap();
        assert_eq!(homed.verdict, Verdict::Bad);
        assert_eq!(arm.prepare(&path()), Err(ArmError::Client(ArmClientError::NotHomed)));
        assert!(emulator.journal().iter().all(|line| !line.is_busy), "it never moved");
    }

    #[test]
    fn a_standing_alarm_is_explained_and_nothing_moves() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        emulator.inject("alarm=0x45@POSE".parse::<Fault>().unwrap());
        arm.client().pose().unwrap();
        let alarms =
            arm.check(None).into_iter().find(|finding| finding.subject == "alarms").unwrap();
        assert_eq!(alarms.verdict, Verdict::Bad);
        assert!(
            alarms.description.contains("joint 3 is at its lower limit"),
            "{}",
            alarms.description
        );
        let n_before = emulator.journal().len();
        let error = arm.prepare(&path()).unwrap_err();
        assert!(matches!(error, ArmError::Client(ArmClientError::Alarmed { .. })), "{error}");
        assert!(emulator.journal()[n_before..].iter().all(|line| !line.is_busy));
    }

    #[test]
    fn an_alarm_under_way_stops_the_arm_and_is_reported() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        arm.prepare(&path()).unwrap();
        emulator.inject("alarm=0x22@POSE#60".parse::<Fault>().unwrap());
        let error = drive(&mut arm, 0..3).unwrap_err().to_string();
        assert!(error.contains("joint limit"), "{error}");
        let writes: Vec<String> = emulator
            .journal()
            .into_iter()
            .filter(|line| line.ctrl != 0)
            .map(|line| line.name)
            .collect();
        let last = ["QUEUE_FORCE_STOP".to_owned(), "QUEUE_CLEAR".to_owned()];
        assert!(writes.ends_with(&last), "{writes:?}");
        assert_eq!((emulator.state().is_busy, emulator.state().n_waiting), (false, 0));
    }

    #[test]
    fn a_firmware_that_clamps_the_speed_is_found_out_before_anything_moves() {
        let emulator = emulator(ArmOptions { clamps: true, ..ArmOptions::default() });
        let mut arm = homed(&emulator);
        // A description that promises more than the firmware does.
        arm.description.speed.speed_mm_per_s = 1_000.0;
        let start = Pose::from_mm_deg([240.0, 0.0, 100.0, 90.0]);
        let end = Pose::from_mm_deg([240.0, 50.0, 100.0, 90.0]);
        let mut path = ToolPath::new(start);
        path.push("fast", 0, ToolCurve::line(start, end), rates(500.0), StepSettings::default());
        let n_before = emulator.journal().len();
        let error = arm.prepare(&path).unwrap_err();
        assert!(matches!(error, ArmError::Client(ArmClientError::ReadBack { .. })), "{error}");
        assert!(emulator.journal()[n_before..].iter().all(|line| !line.is_busy));
    }

    #[test]
    fn a_path_out_of_reach_or_too_fast_is_named_and_nothing_moves() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        let start = Pose::from_mm_deg([240.0, 0.0, 100.0, 90.0]);
        let n_before = emulator.journal().len();
        for (end, speed, words) in [
            ([400.0, 0.0, 100.0, 90.0], 50.0, "radius"),
            ([240.0, 20.0, 100.0, 90.0], 900.0, "speed"),
        ] {
            let mut path = ToolPath::new(start);
            let curve = ToolCurve::line(start, Pose::from_mm_deg(end));
            path.push("away", 0, curve, rates(speed), StepSettings::default());
            let finding = arm.check(Some(&path)).pop().unwrap();
            assert_eq!((finding.subject.as_str(), finding.verdict), ("path", Verdict::Bad));
            assert!(finding.description.contains(words), "{}", finding.description);
            assert!(matches!(arm.prepare(&path), Err(ArmError::BeyondLimit(_))));
        }
        let fine = arm.check(Some(&path())).pop().unwrap();
        assert_eq!(
            (fine.subject.as_str(), fine.verdict),
            ("path", Verdict::Good),
            "{}",
            fine.description
        );
        assert!(emulator.journal()[n_before..].iter().all(|line| !line.is_busy));
    }

    #[test]
    fn the_port_is_found_by_who_answers_and_held_by_one_program() {
        let emulator = emulator(ArmOptions::default());
        assert_eq!(super::super::find::answers(emulator.port()), Ok(()));
        let held = port::open(emulator.port()).unwrap();
        let error = port::open(emulator.port()).unwrap_err();
        assert!(matches!(error, PortError::Busy { .. }), "{error}");
        drop(held);
        emulator.inject("garbage".parse::<Fault>().unwrap());
        let because = super::super::find::answers(emulator.port()).unwrap_err();
        assert!(because.contains("something else"), "{because}");
    }

    #[test]
    fn lost_and_corrupt_replies_neither_lose_nor_repeat_a_command() {
        for kind in [FaultKind::LostReply, FaultKind::LostRequest, FaultKind::CorruptReply] {
            let emulator = emulator(ArmOptions::default());
            let mut arm = homed(&emulator);
            arm.prepare(&path()).unwrap();
            for (name, n) in [("WAIT", 2), ("CIRCLE", 1), ("ARC_PARAMS", 1), ("POSE", 9)] {
                let id = (0..=u8::MAX).find(|id| id::name(*id) == Some(name)).unwrap();
                emulator.inject(Fault::at(kind, id, n));
            }
            let n_before = emulator.journal().len();
            let seen = drive(&mut arm, 0..3).unwrap();
            let turns = seen.windows(2).map(turned).sum::<f64>();
            assert!((turns.abs() - 2.0).abs() < 0.01, "{kind:?}: {turns} turns");
            let journal = emulator.journal();
            let taken = |name| journal[n_before..].iter().filter(|line| line.name == name).count();
            assert_eq!(taken("CIRCLE"), 1, "{kind:?}");
        }
    }

    /// Share of a turn about the circle's centre between two looks.
    fn turned(pair: &[Progress]) -> f64 {
        let angle = |progress: &Progress| {
            let [x, y, ..] = progress.pose.pose.to_mm_deg();
            y.atan2(x - 252.0)
        };
        let turn = (angle(&pair[1]) - angle(&pair[0])) / std::f64::consts::TAU;
        turn - turn.round()
    }

    #[test]
    fn a_late_reply_is_taken_for_what_it_is() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        arm.prepare(&path()).unwrap();
        emulator.inject("late-reply=450ms@CIRCLE".parse::<Fault>().unwrap());
        emulator.inject("late-reply=450ms@POSE#5".parse::<Fault>().unwrap());
        let n_before = emulator.journal().len();
        drive(&mut arm, 0..3).unwrap();
        let journal = emulator.journal();
        let n_circles = journal[n_before..].iter().filter(|line| line.name == "CIRCLE").count();
        assert_eq!(n_circles, 1);
    }

    #[test]
    fn replies_that_trickle_in_are_put_together() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        emulator.inject("trickle".parse::<Fault>().unwrap());
        assert_eq!(arm.identify().unwrap().firmware, "3.7.0");
    }

    #[test]
    fn silence_garbage_a_wedge_and_a_pulled_cable_are_distinguished() {
        for (fault, words) in [
            ("silence", "did not answer"),
            ("garbage", "something else may be at this port"),
            ("wedge", "press its reset button"),
            ("unplug", "is gone"),
        ] {
            let emulator = emulator(ArmOptions::default());
            let mut arm = magician(&emulator);
            emulator.inject(fault.parse::<Fault>().unwrap());
            let findings = arm.check(None);
            assert_eq!(findings[0].verdict, Verdict::Bad);
            assert!(
                findings[0].description.contains(words),
                "{fault}: {}",
                findings[0].description
            );
            assert_eq!(findings.len(), 1, "what does not answer as an arm is asked nothing more");
        }
    }

    #[test]
    fn a_power_cycle_under_way_is_noticed() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        arm.prepare(&path()).unwrap();
        emulator.inject("power-cycle@POSE#40".parse::<Fault>().unwrap());
        let error = drive(&mut arm, 0..3).unwrap_err();
        assert!(matches!(error, ArmError::Client(ArmClientError::NotHomed)), "{error}");
    }

    #[test]
    fn the_tool_offset_of_the_rig_is_set_and_read_back() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        arm.description.kinematics.tool_offset[0].0 = 61.0;
        let tool = |arm: &mut Magician| arm.check(None).into_iter().find(|f| f.subject == "tool");
        assert_eq!(tool(&mut arm).unwrap().verdict, Verdict::Doubt);
        arm.prepare(&path()).unwrap();
        assert_eq!(tool(&mut arm).unwrap().verdict, Verdict::Good);
    }

    #[test]
    fn poses_are_delivered_while_the_arm_drives_until_it_is_aborted() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        let arm: &mut dyn Arm = &mut arm;
        arm.prepare(&path()).unwrap();
        arm.start(0..3).unwrap();
        let mut poses = Vec::new();
        let mut is_done = false;
        while !is_done {
            let progress = arm.progress().unwrap();
            poses.push(progress.pose);
            is_done = progress.is_done;
        }
        assert!(poses.len() > 50 && poses.iter().all(|pose| pose.uncertainty() > Span::ZERO));
        arm.prepare(&path()).unwrap();
        arm.start(0..3).unwrap();
        assert!((0..30).all(|_| !arm.progress().unwrap().is_done));
        arm.abort().unwrap();
        assert_eq!((emulator.state().is_busy, emulator.state().n_waiting), (false, 0));
    }

    #[test]
    fn steps_that_begin_elsewhere_are_refused() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator);
        assert!(matches!(arm.start(0..1), Err(ArmError::NotPrepared { n_steps: 0, .. })));
        arm.prepare(&path()).unwrap();
        assert!(matches!(arm.start(2..4), Err(ArmError::NotPrepared { n_steps: 3, .. })));
        arm.client().begin().unwrap();
        let home = arm.description.home;
        arm.go_to(home).unwrap();
        assert!(matches!(arm.start(1..2), Err(ArmError::NotAtStart { .. })));
    }

    #[test]
    fn a_marker_is_high_while_its_step_is_under_way() {
        let emulator = emulator(ArmOptions::default());
        let mut arm = homed(&emulator).with_marker(Marker { address: 14 });
        arm.prepare(&path()).unwrap();
        drive(&mut arm, 1..2).unwrap();
        let edges: Vec<String> = emulator
            .journal()
            .into_iter()
            .filter(|line| line.name == "IO_OUTPUT" && line.ctrl == 3)
            .map(|line| line.params)
            .collect();
        assert_eq!(edges, ["0e01", "0e00"]);
    }
}
