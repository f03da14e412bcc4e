//! Each device fails in each way at some moment of a recording. The recording ends in time in a
//! sealed session that verifies, and an incomplete session is never marked complete.
//!
//! `EVRIG_FAULTS` sets the number of trials per fault (default 1), each at another moment.

use crate::camera;

use crate::wire::{FaultyWire, WireFault};
use camera::{NumberedCamera, PACKET_EVENTS, find_events};
use evrig::device::davis::{NetworkDavis, NetworkDavisTimeouts};
use evrig::device::dobot::{ArmClient, ArmTimeouts, Magician, port};
use evrig::device::pi::{NetworkPi, PiTimeouts};
use evrig::event::Events;
use evrig::format::aedat4::{Content, StreamSpec};
use evrig::geometry::Size;
use evrig::pi::agent::Agent;
use evrig::pi::order::CaptureSettings;
use evrig::pi::source::Synthetic;
use evrig::record::Finding;
use evrig::record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderSample, RecorderTally, host_time,
};
use evrig::record::{
    Devices, Dwells, Prompts, RecordOutcome, RecordRequest, RecordState, StopToken, record,
};
use evrig::rig::Rig;
use evrig::session::{Session, SessionStatus, verify};
use evrig::sim::arm::fault::Fault as ArmFault;
use evrig::sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use evrig::time::Span;
use evrig::trajectory::{OptionalSegments, Trajectory};
use evrig::units::Hertz;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// The arm's time advances with each request, so that a path has the same number of polls on any
/// machine.
const ARM_STEP: Span = Span::from_micros(20_000);
/// Lower bound of the polls of any run of the path.
const MIN_POLLS: f64 = 60.0;
/// Polls after which a transient fault ends.
const TRANSIENT_POLLS: u32 = 15;
/// Far longer than any recording of two seconds.
const DEADLINE: Duration = Duration::from_secs(120);
const DAVIS_PATIENCE: NetworkDavisTimeouts = NetworkDavisTimeouts {
    connect: Duration::from_secs(2),
    silence: Duration::from_millis(300),
    reconnect: Duration::from_millis(500),
    drain: Duration::from_millis(100),
};
const PI_PATIENCE: PiTimeouts = PiTimeouts {
    answer: Duration::from_secs(5),
    silence: Duration::from_millis(500),
    configure: Duration::from_secs(20),
    // Queued frames arrive late on a busy machine, which is not a fault.
    drain: Duration::from_secs(20),
};
const WIRE_FAULTS: [WireFault; 5] = [
    WireFault::Unplugged,
    WireFault::Silent,
    WireFault::Slow,
    WireFault::Garbage,
    WireFault::Restarted,
];

/// The devices of a rig and the proxies to them.
struct FaultSetup {
    emulator: ArmEmulator,
    _agent: Agent,
    _camera: NumberedCamera,
    davis: FaultyWire,
    pi: FaultyWire,
    folder: tempfile::TempDir,
}

impl FaultSetup {
    fn new() -> Self {
        let options = ArmOptions { is_homed: true, ..ArmOptions::default() };
        let agent =
            Agent::serve("127.0.0.1:0".parse().unwrap(), Box::new(Synthetic::paced())).unwrap();
        // One connection for the preflight, one for the recording; silent until then.
        let camera = NumberedCamera::start(2);
        Self {
            emulator: ArmEmulator::start(options, ArmClock::Stepped(ARM_STEP), Vec::new()).unwrap(),
            davis: FaultyWire::to(camera.address.parse().unwrap()),
            pi: FaultyWire::to(agent.address()),
            _camera: camera,
            _agent: agent,
            folder: tempfile::tempdir().unwrap(),
        }
    }

    fn devices(&self, rig: &Rig) -> Devices {
        let link = port::open(self.emulator.port()).unwrap();
        // A busy machine answers late, which is not a fault.
        let reply = Span::from_micros(2_000_000);
        let patience = ArmTimeouts { reply, ..ArmTimeouts::default() };
        let arm = Magician::over(ArmClient::new(Box::new(link), patience), rig.arm.clone());
        let settings = CaptureSettings {
            size: Size::new(48, 32),
            frame_rate: Hertz(120.0),
            exposure: Span::from_micros(4_000),
            gain: 1.0,
            raw: true,
            rgb: false,
        };
        let davis = NetworkDavis::new(&self.davis.address(), DAVIS_PATIENCE);
        let pi = NetworkPi::local(&self.pi.address(), settings, PI_PATIENCE);
        Devices { arm: Box::new(arm), recorders: vec![Box::new(davis), Box::new(pi)] }
    }

    /// Records a circle with these devices.
    fn record_with(
        &self,
        devices: &mut Devices,
        watch: &mut dyn FnMut(RecordState, f64),
    ) -> RecordOutcome {
        let rig = Rig::simulated().unwrap();
        let trajectory = Trajectory::find("circle").unwrap();
        let path = trajectory.path(&rig, OptionalSegments::Included).unwrap();
        let rest = Duration::from_millis(50);
        let request = RecordRequest {
            rig: &rig,
            trajectory: &trajectory,
            path: &path,
            out: &self.out(),
            dwells: Dwells { lead_in: rest, tail: rest },
            prompts: Prompts::default(),
        };
        record(request, devices, &StopToken::default(), watch).unwrap()
    }

    /// Records; `fail` is called with the number of polls of the arm.
    fn record(&self, fail: &mut dyn FnMut(u32)) -> RecordOutcome {
        let mut n_polls = 0;
        let mut watch = |state, _| {
            if state == RecordState::Trajectory {
                fail(n_polls);
                n_polls += 1;
            }
        };
        self.record_with(&mut self.devices(&Rig::simulated().unwrap()), &mut watch)
    }

    fn out(&self) -> std::path::PathBuf {
        self.folder.path().join("session")
    }
}

/// Runs a trial on its own thread, so that a hang is detected.
fn run_with_deadline<T: Send + 'static>(
    what: String,
    trial: impl FnOnce() -> T + Send + 'static,
) -> T {
    let (sender, receiver) = channel();
    let thread = std::thread::spawn(move || {
        let outcome = trial();
        let _ = sender.send(());
        outcome
    });
    let began = Instant::now();
    let ended = receiver.recv_timeout(DEADLINE);
    let hangs = matches!(ended, Err(RecvTimeoutError::Timeout));
    assert!(!hangs, "{what}: still recording after {:?}", began.elapsed());
    thread.join().unwrap_or_else(|_| panic!("{what}"))
}

fn verified(out: &Path, what: &str) -> Session {
    let session = Session::open(out).unwrap();
    let verification = verify(&session).unwrap();
    assert!(verification.holds(), "{what}: {:#?}", verification.findings);
    session
}

fn n_rounds() -> u64 {
    std::env::var("EVRIG_FAULTS").map_or(1, |n| n.parse().expect("a number"))
}

/// Poll of the arm at which a trial injects its fault: in the first 60 %, another for each trial.
fn fault_poll(trial: u64) -> u32 {
    let mixed = (trial + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    3 + (0.6 * MIN_POLLS * (mixed >> 40) as f64 / (1_u64 << 24) as f64) as u32
}

/// Attempts to record when a busy machine ends the recording.
const MAX_ATTEMPTS: usize = 4;

/// Half of the time that evrig waits for an answer here.
const MIN_STALL: Duration = Duration::from_secs(1);

/// Runs a function and measures the longest time for which a concurrent thread was not scheduled.
fn measure_longest_stall<T>(run: impl FnOnce() -> T) -> (T, Duration) {
    let (end, ended) = channel::<()>();
    let watch = std::thread::spawn(move || {
        let tick = Duration::from_millis(10);
        let mut longest = Duration::ZERO;
        loop {
            let before = Instant::now();
            let is_over = ended.recv_timeout(tick) != Err(RecvTimeoutError::Timeout);
            longest = longest.max(before.elapsed());
            if is_over {
                return longest;
            }
        }
    });
    let given = run();
    drop(end);
    (given, watch.join().unwrap())
}

/// Repeats a recording if the simulated arm, which has no permanent fault, did not answer because
/// the machine stalled. A stop has a shorter timeout, which a busy machine may exceed without a
/// stall.
fn retry_on_machine_stall(
    record: impl Fn() -> (FaultSetup, RecordOutcome),
) -> (FaultSetup, RecordOutcome) {
    for _ in 0..MAX_ATTEMPTS {
        let ((setup, outcome), stall) = measure_longest_stall(&record);
        let why = outcome.cut_short.as_deref().unwrap_or_default();
        let is_late = why.starts_with("the arm did not answer");
        if !(is_late && (stall >= MIN_STALL || why.contains("did not answer `QUEUE_"))) {
            return (setup, outcome);
        }
        eprintln!("{why}: the machine stalled for {stall:?}; retrying");
    }
    panic!("the machine is too busy for the simulated arm");
}

/// Tries each fault of the proxy that `wire` selects.
fn try_wire(name: &'static str, wire: fn(&FaultSetup) -> &FaultyWire) {
    for round in 0..n_rounds() {
        for (i, fault) in WIRE_FAULTS.into_iter().enumerate() {
            let at = fault_poll(round * WIRE_FAULTS.len() as u64 + i as u64);
            let what = format!("{name} {fault:?} at poll {at}");
            let (setup, outcome) = retry_on_machine_stall(|| {
                run_with_deadline(what.clone(), move || {
                    let setup = FaultSetup::new();
                    let mut is_set = false;
                    let outcome = setup.record(&mut |poll| {
                        if !is_set && poll >= at {
                            is_set = true;
                            wire(&setup).set(fault);
                        } else if poll >= at + TRANSIENT_POLLS
                            && matches!(fault, WireFault::Slow | WireFault::Restarted)
                        {
                            wire(&setup).set_back();
                        }
                    });
                    (setup, outcome)
                })
            });
            check_session(&setup, &outcome, fault, name, &what);
        }
    }
}

fn check_session(
    setup: &FaultSetup,
    outcome: &RecordOutcome,
    fault: WireFault,
    name: &str,
    what: &str,
) {
    let session = verified(&setup.out(), what);
    let manifest = session.manifest();
    let losses = manifest.losses.iter().map(|loss| format!("{}: {}", loss.stream, loss.what));
    let losses: Vec<_> = losses.collect();
    eprintln!("{what}: {:?}, {losses:?}", manifest.status);
    let found = find_events(&session.layout().davis());
    let is_marked_complete = manifest.status == SessionStatus::Complete && losses.is_empty();
    match fault {
        // Late but complete.
        WireFault::Slow => assert!(!is_marked_complete || found.n_gaps == 0, "{what}: {found:?}"),
        // The protocol has no checksum inside a packet: altered events may be in the file, and the
        // session records the failure.
        _ => assert!(!is_marked_complete, "{what}: marked complete"),
    }
    if name == "pi" || fault != WireFault::Garbage {
        assert_eq!(found.n_wrong, 0, "{what}: {found:?}");
    }
    if manifest.status == SessionStatus::Aborted {
        let why = outcome.cut_short.as_deref().unwrap_or_default();
        assert!(why.contains(name), "{what}: {why}");
    }
    let arm = setup.emulator.state();
    assert!(!arm.is_busy && arm.n_waiting == 0, "{what}: the arm moves: {arm:?}");
}

#[test]
fn a_failing_event_camera_leaves_a_session_that_records_the_failure() {
    try_wire("davis", |setup| &setup.davis);
}

#[test]
fn a_failing_frame_camera_leaves_a_session_that_records_the_failure() {
    try_wire("pi", |setup| &setup.pi);
}

/// Set inside the network namespace of this test.
const IN_NAMESPACE: &str = "EVRIG_TEST_NAMESPACE";
/// Cuts the network without notice to either end.
const CUT: &str = "ip link set lo down";

fn shell(command: &str) {
    let done = Command::new("sh").args(["-c", command]).status().unwrap();
    assert!(done.success(), "{command}: {done}");
}

#[test]
fn a_failing_network_leaves_a_session_that_records_the_failure() {
    if std::env::var_os(IN_NAMESPACE).is_some() {
        shell("ip link set lo up");
        try_network();
        return;
    }
    let namespace = ["--user", "--map-root-user", "--net"];
    let probe = "ip link set lo up";
    let probed = Command::new("unshare").args(namespace).args(["sh", "-c", probe]).output();
    if !probed.is_ok_and(|probed| probed.status.success()) {
        eprintln!("skipped: this system has no network namespaces or no `ip`");
        return;
    }
    let name = "faults::a_failing_network_leaves_a_session_that_records_the_failure";
    let ran = Command::new("unshare")
        .args(namespace)
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", name, "--nocapture"])
        .env(IN_NAMESPACE, "1")
        .status();
    assert!(ran.unwrap().success());
}

fn try_network() {
    for round in 0..n_rounds() {
        let at = fault_poll(round);
        let what = format!("network cut at poll {at}");
        let (setup, outcome) = run_with_deadline(what.clone(), move || {
            let setup = FaultSetup::new();
            let mut is_cut = false;
            let outcome = setup.record(&mut |poll| {
                if !is_cut && poll >= at {
                    is_cut = true;
                    shell(CUT);
                }
            });
            // For the next trial and for pending requests.
            shell("ip link set lo up");
            (setup, outcome)
        });
        let session = verified(&setup.out(), &what);
        let manifest = session.manifest();
        eprintln!("{what}: {:?}, {:?}, {:?}", manifest.status, outcome.cut_short, manifest.losses);
        let found = find_events(&session.layout().davis());
        assert_eq!(found.n_wrong, 0, "{what}: {found:?}");
        let is_marked_complete =
            manifest.status == SessionStatus::Complete && manifest.losses.is_empty();
        assert!(!is_marked_complete, "{what}: marked complete");
        let arm = setup.emulator.state();
        assert!(!arm.is_busy && arm.n_waiting == 0, "{what}: the arm moves: {arm:?}");
    }
}

/// Records with a fault of the arm.
fn record_with_arm_fault(fault: &str) -> (FaultSetup, RecordOutcome) {
    let text = fault.to_owned();
    run_with_deadline(text.clone(), move || {
        let setup = FaultSetup::new();
        let fault: ArmFault = text.parse().unwrap();
        let mut is_set = false;
        let outcome = setup.record(&mut |_| {
            if !is_set {
                is_set = true;
                setup.emulator.inject(fault);
            }
        });
        (setup, outcome)
    })
}

#[test]
fn a_failing_arm_leaves_a_session_that_records_the_failure() {
    // A transient fault is retried; a permanent one ends the recording.
    let transient = ["lost-request", "lost-reply", "late-reply=150ms", "corrupt-reply"];
    let permanent = ["silence", "garbage", "wedge", "unplug", "alarm=0x22", "power-cycle"];
    for round in 0..n_rounds() {
        for (i, kind) in transient.into_iter().chain(permanent).enumerate() {
            let n_pose = fault_poll(round * 10 + i as u64);
            let fault = format!("{kind}@POSE#{n_pose}");
            let (setup, outcome) = if permanent.contains(&kind) {
                record_with_arm_fault(&fault)
            } else {
                retry_on_machine_stall(|| record_with_arm_fault(&fault))
            };
            let session = verified(&setup.out(), &fault);
            let manifest = session.manifest();
            eprintln!("{fault}: {:?}, {:?}", manifest.status, outcome.cut_short);
            let found = find_events(&session.layout().davis());
            assert_eq!((found.n_gaps, found.n_wrong), (0, 0), "{fault}: the camera did not fail");
            if permanent.contains(&kind) {
                assert_eq!(manifest.status, SessionStatus::Aborted, "{fault}");
                assert!(!manifest.losses.is_empty(), "{fault}");
            } else {
                assert_eq!(
                    (manifest.status, &outcome.cut_short),
                    (SessionStatus::Complete, &None),
                    "{fault}"
                );
            }
        }
    }
}

/// An event camera whose packets arrive while the host's wall clock is stepped by hours.
struct SteppedClockCamera {
    n_sent: u64,
    outlet: Option<evrig::record::recorder::SampleSender>,
}

impl SteppedClockCamera {
    fn send(&mut self) {
        let mut arrived = host_time();
        let hours = [0, 2, -3][(self.n_sent / 10 % 3) as usize];
        arrived.unix = arrived.unix + Span::from_micros(hours * 3_600_000_000);
        let first = self.n_sent as i64 * PACKET_EVENTS;
        let events: Events = (first..first + PACKET_EVENTS).map(camera::event).collect();
        let content = Content::Events(events);
        let outlet = self.outlet.as_ref().expect("the camera was started");
        assert!(outlet.offer(RecorderSample::Packet { stream: 0, arrived, content }));
        self.n_sent += 1;
    }
}

impl Recorder for SteppedClockCamera {
    fn name(&self) -> &'static str {
        "davis"
    }
    fn check(&mut self) -> Vec<Finding> {
        Vec::new()
    }
    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        let streams = vec![StreamSpec::events(Size::DAVIS346, "DAVIS346_1")];
        Ok(PreparedRecorder { description: serde_json::json!({}), streams })
    }
    fn start(
        &mut self,
        outlet: evrig::record::recorder::SampleSender,
    ) -> Result<(), RecorderError> {
        self.outlet = Some(outlet);
        self.send();
        Ok(())
    }
    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        self.send();
        Ok(RecorderTally { n_samples: self.n_sent, ..RecorderTally::default() })
    }
    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.outlet = None;
        Ok(RecorderTally { n_samples: self.n_sent, ..RecorderTally::default() })
    }
    fn abort(&mut self) {
        self.outlet = None;
    }
}

#[test]
fn clock_steps_of_hours_lose_no_sample_and_keep_monotonic_time() {
    let setup = FaultSetup::new();
    let mut devices = setup.devices(&Rig::simulated().unwrap());
    devices.recorders = vec![Box::new(SteppedClockCamera { n_sent: 0, outlet: None })];
    let outcome = setup.record_with(&mut devices, &mut |_, _| {});
    assert_eq!(outcome.manifest.status, SessionStatus::Complete);
    let session = verified(&setup.out(), "stepped clock");
    let found = find_events(&session.layout().davis());
    assert_eq!((found.n_gaps, found.n_wrong), (0, 0), "{found:?}");
    let arrivals = session.rig_log_contents().unwrap().arrivals;
    assert_eq!(arrivals.len() as i64 * PACKET_EVENTS, found.next);
    let goes_back = |pair: &[evrig::session::PacketArrival]| {
        pair[1].arrived.monotonic < pair[0].arrived.monotonic
    };
    assert!(!arrivals.windows(2).any(goes_back), "the monotonic clock does not step");
    let was_set = |pair: &[evrig::session::PacketArrival]| {
        (pair[1].arrived.unix - pair[0].arrived.unix).as_secs_f64().abs() > 3_000.0
    };
    assert!(
        arrivals.windows(2).filter(|pair| was_set(pair)).count() >= 2,
        "the wall clock was stepped"
    );
}
