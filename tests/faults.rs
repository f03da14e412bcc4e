//! Each device fails in each way at some moment of a recording: it ends in time, in a sealed session
//! that verifies, and one that lacks something never claims to be whole.
//!
//! `EVRIG_FAULTS` says how often each way is tried (1), each time at another moment.

#![allow(clippy::expect_used, clippy::unwrap_used, clippy::print_stderr, unreachable_pub)]
#![cfg(unix)]

#[path = "wires/camera.rs"]
#[allow(dead_code)]
mod camera;
#[path = "wires/wire.rs"]
mod wire;

use camera::{Camera, PACKET_EVENTS, find_events};
use evrig::device::davis::{NetworkDavis, Patience as DavisPatience};
use evrig::device::dobot::{Client, Magician, Patience as ArmPatience, port};
use evrig::device::pi::{NetworkPi, Patience as PiPatience};
use evrig::event::Events;
use evrig::format::aedat4::{Content, StreamSpec};
use evrig::geometry::Size;
use evrig::pi::agent::Agent;
use evrig::pi::source::Synthetic;
use evrig::pi::wire::Settings;
use evrig::record::Finding;
use evrig::record::recorder::{Prepared, Recorder, RecorderError, Sample, Tally, host_time};
use evrig::record::{Devices, Dwells, Outcome, Prompts, Request, State, StopToken, record};
use evrig::rig::Rig;
use evrig::session::{Session, SessionStatus, verify};
use evrig::sim::arm::fault::Fault as ArmFault;
use evrig::sim::arm::{Clock, Emulator, Options};
use evrig::time::Span;
use evrig::trajectory::{OptionalSegments, Trajectory};
use evrig::units::Hertz;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use wire::{Fault, Wire};

/// The arm's time passes by requests, so that a path has as many looks at the arm on any machine.
const ARM_STEP: Span = Span::from_micros(20_000);
/// Fewer looks than any run of the path has.
const LOOKS: f64 = 60.0;
/// A fault that passes does so after so many.
const PASSING: u32 = 15;
/// No recording of two seconds takes so long, whatever fails.
const DEADLINE: Duration = Duration::from_secs(120);
const DAVIS_PATIENCE: DavisPatience = DavisPatience {
    connect: Duration::from_secs(2),
    silence: Duration::from_millis(300),
    reconnect: Duration::from_millis(500),
    drain: Duration::from_millis(100),
};
const PI_PATIENCE: PiPatience = PiPatience {
    answer: Duration::from_secs(5),
    silence: Duration::from_millis(500),
    configure: Duration::from_secs(20),
    // What waits there comes late on a busy machine, and that is no fault either.
    drain: Duration::from_secs(20),
};
const WIRE_FAULTS: [Fault; 5] =
    [Fault::Unplugged, Fault::Silent, Fault::Slow, Fault::Garbage, Fault::Restarted];

/// The wires of a rig, and what stands behind them.
struct Bench {
    emulator: Emulator,
    _agent: Agent,
    _camera: Camera,
    davis: Wire,
    pi: Wire,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let options = Options { is_homed: true, ..Options::default() };
        let agent =
            Agent::serve("127.0.0.1:0".parse().unwrap(), Box::new(Synthetic::paced())).unwrap();
        // One connection for the preflight, one for the recording, and so long it is silent.
        let camera = Camera::start(2);
        Self {
            emulator: Emulator::start(options, Clock::Stepped(ARM_STEP), Vec::new()).unwrap(),
            davis: Wire::to(camera.address.parse().unwrap()),
            pi: Wire::to(agent.address()),
            _camera: camera,
            _agent: agent,
            folder: tempfile::tempdir().unwrap(),
        }
    }

    fn devices(&self, rig: &Rig) -> Devices {
        let link = port::open(self.emulator.port()).unwrap();
        // A busy machine answers late, and that is no fault.
        let reply = Span::from_micros(2_000_000);
        let patience = ArmPatience { reply, ..ArmPatience::default() };
        let arm = Magician::over(Client::new(Box::new(link), patience), rig.arm.clone());
        let settings = Settings {
            size: Size::new(48, 32),
            frame_rate: Hertz(120.0),
            exposure: Span::from_micros(4_000),
            gain: 1.0,
            raw: true,
            rgb: false,
        };
        let davis = NetworkDavis::new(&self.davis.address(), DAVIS_PATIENCE);
        let pi = NetworkPi::new(&self.pi.address(), settings, PI_PATIENCE);
        Devices { arm: Box::new(arm), recorders: vec![Box::new(davis), Box::new(pi)] }
    }

    /// Records a circle with these devices.
    fn record_with(&self, devices: &mut Devices, watch: &mut dyn FnMut(State, f64)) -> Outcome {
        let rig = Rig::simulated().unwrap();
        let trajectory = Trajectory::find("circle").unwrap();
        let path = trajectory.path(&rig, OptionalSegments::Included).unwrap();
        let rest = Duration::from_millis(50);
        let request = Request {
            rig: &rig,
            trajectory: &trajectory,
            path: &path,
            out: &self.out(),
            dwells: Dwells { lead_in: rest, tail: rest },
            prompts: Prompts::default(),
        };
        record(request, devices, &StopToken::default(), watch).unwrap()
    }

    /// Records; `fail` is told how many looks at the arm there were.
    fn record(&self, fail: &mut dyn FnMut(u32)) -> Outcome {
        let mut n_looks = 0;
        let mut watch = |state, _| {
            if state == State::Trajectory {
                fail(n_looks);
                n_looks += 1;
            }
        };
        self.record_with(&mut self.devices(&Rig::simulated().unwrap()), &mut watch)
    }

    fn out(&self) -> std::path::PathBuf {
        self.folder.path().join("session")
    }
}

/// Runs a trial on a thread of its own: a hang is an answer too.
fn within_the_deadline<T: Send + 'static>(
    what: String,
    trial: impl FnOnce() -> T + Send + 'static,
) -> T {
    let (tell, told) = channel();
    let thread = std::thread::spawn(move || {
        let outcome = trial();
        let _ = tell.send(());
        outcome
    });
    let began = Instant::now();
    let ended = told.recv_timeout(DEADLINE);
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

/// A look at the arm between the third and the last but a third, another for each trial.
fn moment(trial: u64) -> u32 {
    let mixed = (trial + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    3 + (0.6 * LOOKS * (mixed >> 40) as f64 / (1_u64 << 24) as f64) as u32
}

/// So often a recording is tried that a busy machine ends.
const TRIALS: usize = 4;

/// Half of what evrig waits for an answer here.
const STILL: Duration = Duration::from_secs(1);

/// Runs something; for how long, at most, a thread beside it that asks to run all the time was not run.
fn with_longest_stall<T>(run: impl FnOnce() -> T) -> (T, Duration) {
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

/// Records anew when the simulated arm, which has no fault that lasts, did not answer because the
/// machine stood still. A stop has its own, shorter patience, which a busy one may exceed anyway.
fn unless_the_machine_stands_still(record: impl Fn() -> (Bench, Outcome)) -> (Bench, Outcome) {
    for _ in 0..TRIALS {
        let ((bench, outcome), stall) = with_longest_stall(&record);
        let why = outcome.cut_short.as_deref().unwrap_or_default();
        let is_late = why.starts_with("the arm did not answer");
        if !(is_late && (stall >= STILL || why.contains("did not answer `QUEUE_"))) {
            return (bench, outcome);
        }
        eprintln!("{why}: the machine stood still for {stall:?}; once more");
    }
    panic!("the machine is too busy for the simulated arm");
}

/// Tries each fault of a wire; `wire` chooses it.
fn try_wire(name: &'static str, wire: fn(&Bench) -> &Wire) {
    for round in 0..n_rounds() {
        for (i, fault) in WIRE_FAULTS.into_iter().enumerate() {
            let at = moment(round * WIRE_FAULTS.len() as u64 + i as u64);
            let what = format!("{name} {fault:?} at look {at}");
            let (bench, outcome) = unless_the_machine_stands_still(|| {
                within_the_deadline(what.clone(), move || {
                    let bench = Bench::new();
                    let mut is_set = false;
                    let outcome = bench.record(&mut |look| {
                        if !is_set && look >= at {
                            is_set = true;
                            wire(&bench).set(fault);
                        } else if look >= at + PASSING
                            && matches!(fault, Fault::Slow | Fault::Restarted)
                        {
                            wire(&bench).set_back();
                        }
                    });
                    (bench, outcome)
                })
            });
            check_session(&bench, &outcome, fault, name, &what);
        }
    }
}

fn check_session(bench: &Bench, outcome: &Outcome, fault: Fault, name: &str, what: &str) {
    let session = verified(&bench.out(), what);
    let manifest = session.manifest();
    let told = manifest.losses.iter().map(|loss| format!("{}: {}", loss.stream, loss.what));
    let told: Vec<_> = told.collect();
    eprintln!("{what}: {:?}, {told:?}", manifest.status);
    let found = find_events(&session.layout().davis());
    let claims_all = manifest.status == SessionStatus::Complete && told.is_empty();
    match fault {
        // Late, but all of it.
        Fault::Slow => assert!(!claims_all || found.n_gaps == 0, "{what}: {found:?}"),
        // On this wire nothing protects a packet's inside: what was altered may be in the file, and
        // the session says that the wire failed.
        _ => assert!(!claims_all, "{what}: claims to be whole"),
    }
    if name == "pi" || fault != Fault::Garbage {
        assert_eq!(found.n_wrong, 0, "{what}: {found:?}");
    }
    if manifest.status == SessionStatus::Aborted {
        let why = outcome.cut_short.as_deref().unwrap_or_default();
        assert!(why.contains(name), "{what}: {why}");
    }
    let arm = bench.emulator.state();
    assert!(!arm.is_busy && arm.n_waiting == 0, "{what}: the arm moves: {arm:?}");
}

#[test]
fn an_event_camera_that_fails_leaves_a_session_that_says_so() {
    try_wire("davis", |bench| &bench.davis);
}

#[test]
fn a_frame_camera_that_fails_leaves_a_session_that_says_so() {
    try_wire("pi", |bench| &bench.pi);
}

/// Set in a network namespace of our own.
const IN_NAMESPACE: &str = "EVRIG_TEST_NAMESPACE";
/// Takes the network away: no word of it reaches either end, which only notice that nothing comes.
const CUT: &str = "ip link set lo down";

fn shell(command: &str) {
    let done = Command::new("sh").args(["-c", command]).status().unwrap();
    assert!(done.success(), "{command}: {done}");
}

#[test]
fn a_network_that_is_cut_leaves_a_session_that_says_so() {
    if std::env::var_os(IN_NAMESPACE).is_some() {
        shell("ip link set lo up");
        try_network();
        return;
    }
    let namespace = ["--user", "--map-root-user", "--net"];
    let probe = "ip link set lo up";
    let probed = Command::new("unshare").args(namespace).args(["sh", "-c", probe]).output();
    if !probed.is_ok_and(|probed| probed.status.success()) {
        eprintln!("skipped: this system gives no network namespace, or has no `ip`");
        return;
    }
    let name = "a_network_that_is_cut_leaves_a_session_that_says_so";
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
        let at = moment(round);
        let what = format!("network cut at look {at}");
        let (bench, outcome) = within_the_deadline(what.clone(), move || {
            let bench = Bench::new();
            let mut is_cut = false;
            let outcome = bench.record(&mut |look| {
                if !is_cut && look >= at {
                    is_cut = true;
                    shell(CUT);
                }
            });
            // For what comes next, and for whoever still waits for an answer.
            shell("ip link set lo up");
            (bench, outcome)
        });
        let session = verified(&bench.out(), &what);
        let manifest = session.manifest();
        eprintln!("{what}: {:?}, {:?}, {:?}", manifest.status, outcome.cut_short, manifest.losses);
        let found = find_events(&session.layout().davis());
        assert_eq!(found.n_wrong, 0, "{what}: {found:?}");
        let claims_all = manifest.status == SessionStatus::Complete && manifest.losses.is_empty();
        assert!(!claims_all, "{what}: claims to be whole");
        let arm = bench.emulator.state();
        assert!(!arm.is_busy && arm.n_waiting == 0, "{what}: the arm moves: {arm:?}");
    }
}

/// Records while the arm has a fault.
fn strike(fault: &str) -> (Bench, Outcome) {
    let text = fault.to_owned();
    within_the_deadline(text.clone(), move || {
        let bench = Bench::new();
        let fault: ArmFault = text.parse().unwrap();
        let mut is_set = false;
        let outcome = bench.record(&mut |_| {
            if !is_set {
                is_set = true;
                bench.emulator.inject(fault);
            }
        });
        (bench, outcome)
    })
}

#[test]
fn an_arm_that_fails_leaves_a_session_that_says_so() {
    // What strikes once is asked again; what lasts ends the recording.
    let passing = ["lost-request", "lost-reply", "late-reply=150ms", "corrupt-reply"];
    let lasting = ["silence", "garbage", "wedge", "unplug", "alarm=0x22", "power-cycle"];
    for round in 0..n_rounds() {
        for (i, kind) in passing.into_iter().chain(lasting).enumerate() {
            let n_pose = moment(round * 10 + i as u64);
            let said = format!("{kind}@POSE#{n_pose}");
            let (bench, outcome) = if lasting.contains(&kind) {
                strike(&said)
            } else {
                unless_the_machine_stands_still(|| strike(&said))
            };
            let session = verified(&bench.out(), &said);
            let manifest = session.manifest();
            eprintln!("{said}: {:?}, {:?}", manifest.status, outcome.cut_short);
            let found = find_events(&session.layout().davis());
            assert_eq!((found.n_gaps, found.n_wrong), (0, 0), "{said}: the camera was well");
            if lasting.contains(&kind) {
                assert_eq!(manifest.status, SessionStatus::Aborted, "{said}");
                assert!(!manifest.losses.is_empty(), "{said}");
            } else {
                assert_eq!(
                    (manifest.status, &outcome.cut_short),
                    (SessionStatus::Complete, &None),
                    "{said}"
                );
            }
        }
    }
}

/// An event camera whose packets arrive while the host's wall clock is set to and fro by hours.
struct Unsettled {
    n_sent: u64,
    outlet: Option<evrig::record::recorder::Outlet>,
}

impl Unsettled {
    fn send(&mut self) {
        let mut arrived = host_time();
        let hours = [0, 2, -3][(self.n_sent / 10 % 3) as usize];
        arrived.unix = arrived.unix + Span::from_micros(hours * 3_600_000_000);
        let first = self.n_sent as i64 * PACKET_EVENTS;
        let events: Events = (first..first + PACKET_EVENTS).map(camera::event).collect();
        let content = Content::Events(events);
        let outlet = self.outlet.as_ref().expect("it was started");
        assert!(outlet.offer(Sample::Packet { stream: 0, arrived, content }));
        self.n_sent += 1;
    }
}

impl Recorder for Unsettled {
    fn name(&self) -> &'static str {
        "davis"
    }
    fn check(&mut self) -> Vec<Finding> {
        Vec::new()
    }
    fn prepare(&mut self) -> Result<Prepared, RecorderError> {
        let streams = vec![StreamSpec::events(Size::DAVIS346, "DAVIS346_1")];
        Ok(Prepared { says: serde_json::json!({}), streams })
    }
    fn start(&mut self, outlet: evrig::record::recorder::Outlet) -> Result<(), RecorderError> {
        self.outlet = Some(outlet);
        self.send();
        Ok(())
    }
    fn progress(&mut self) -> Result<Tally, RecorderError> {
        self.send();
        Ok(Tally { n_samples: self.n_sent, ..Tally::default() })
    }
    fn finish(&mut self) -> Result<Tally, RecorderError> {
        self.outlet = None;
        Ok(Tally { n_samples: self.n_sent, ..Tally::default() })
    }
    fn abort(&mut self) {
        self.outlet = None;
    }
}

#[test]
fn a_clock_set_by_hours_both_ways_leaves_every_sample_and_the_time_that_passed() {
    let bench = Bench::new();
    let mut devices = bench.devices(&Rig::simulated().unwrap());
    devices.recorders = vec![Box::new(Unsettled { n_sent: 0, outlet: None })];
    let outcome = bench.record_with(&mut devices, &mut |_, _| {});
    assert_eq!(outcome.manifest.status, SessionStatus::Complete);
    let session = verified(&bench.out(), "a clock set to and fro");
    let found = find_events(&session.layout().davis());
    assert_eq!((found.n_gaps, found.n_wrong), (0, 0), "{found:?}");
    let arrivals = session.rig_log_contents().unwrap().arrivals;
    assert_eq!(arrivals.len() as i64 * PACKET_EVENTS, found.next);
    let goes_back = |pair: &[evrig::session::PacketArrival]| {
        pair[1].arrived.monotonic < pair[0].arrived.monotonic
    };
    assert!(!arrivals.windows(2).any(goes_back), "the monotonic clock does not");
    let was_set = |pair: &[evrig::session::PacketArrival]| {
        (pair[1].arrived.unix - pair[0].arrived.unix).as_secs_f64().abs() > 3_000.0
    };
    assert!(arrivals.windows(2).filter(|pair| was_set(pair)).count() >= 2, "this one was");
}
