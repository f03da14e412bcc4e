//! The guard stops the arm however evrig ends.
//!
//! Each test starts a host process (this test binary again) that drives circles on a simulated arm
//! through the guard, and terminates it in some way.

use evrig::device::dobot::command::{ArmCommand, CartesianLimits, PtpMode};
use evrig::device::dobot::guard::GuardLink;
use evrig::device::dobot::link::LinkError;
use evrig::device::dobot::{ArmClient, ArmClientError, ArmTimeouts};
use evrig::record::{EmergencyStop, host_clock};
use evrig::sim::arm::journal::RequestRecord;
use evrig::sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use evrig::time::Span;
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const EVRIG: &str = env!("CARGO_BIN_EXE_evrig");
/// Set for the host process: the arm's port, and how the host is to end.
const PORT: &str = "EVRIG_TEST_HOST_PORT";
const END: &str = "EVRIG_TEST_HOST_END";

fn emulator() -> ArmEmulator {
    ArmEmulator::start(ArmOptions::default(), ArmClock::Scaled(1.0), Vec::new()).unwrap()
}

fn client(port: &Path) -> (ArmClient, evrig::device::dobot::guard::GuardStop, u32) {
    let link = GuardLink::start(Path::new(EVRIG), port).unwrap();
    let (stopper, id) = (link.stopper().unwrap(), link.id());
    let patience =
        ArmTimeouts { between_polls: Span::from_micros(2_000), ..ArmTimeouts::default() };
    (ArmClient::new(Box::new(link), patience), stopper, id)
}

/// Queues an hour of circles and starts them; returns the index of the last.
fn start_circles(client: &mut ArmClient) -> Result<u64, ArmClientError> {
    let timeout = Span::from_micros(1_000_000);
    client.clear_alarms()?;
    client.begin()?;
    client.set(&ArmCommand::ArcParams(CartesianLimits::uniform(50.0, 200.0)))?;
    let target = [240.0, 0.0, 100.0, 90.0];
    client.enqueue(&ArmCommand::Ptp { mode: PtpMode::MoveJointXyz, target }, timeout)?;
    let (via, to) = ([252.0, 12.0, 100.0, 90.0], [264.0, 0.0, 100.0, 90.0]);
    client.enqueue(&ArmCommand::Circle { via, to, turns: 1_000 }, timeout)?;
    client.enqueue(&ArmCommand::Circle { via, to, turns: 1_000 }, timeout)
}

/// The host process. It does nothing when run as one of the tests.
#[test]
fn host_process() {
    let (Ok(port), Ok(end)) = (std::env::var(PORT), std::env::var(END)) else { return };
    let (mut client, stopper, _) = client(Path::new(&port));
    stopper.halt_on_panic();
    let last = start_circles(&mut client).unwrap();
    let mut n_polls = 0;
    let hour = Span::from_micros(3_600_000_000);
    let waited = client.wait_for(last, hour, &mut |_| {
        n_polls += 1;
        if n_polls == 20 && end == "panic elsewhere" {
            // The thread that drives the arm continues.
            let _ = std::thread::spawn(|| panic!("an intended panic")).join();
        }
        assert!(n_polls < 20 || end != "panic", "an intended panic");
    });
    if end == "panic elsewhere" {
        // Its next commands must not move the arm again.
        let again = start_circles(&mut client);
        assert_eq!(again, Err(ArmClientError::Link(LinkError::Stopped)));
    }
    assert_eq!(waited, Err(ArmClientError::Link(LinkError::Stopped)));
}

fn start_host(port: &Path, end: &str) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "arm_guard::host_process", "--nocapture"])
        .env(PORT, port)
        .env(END, end)
        .process_group(0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Polls until the condition holds; the limit keeps a broken build from hanging.
fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let started = Instant::now();
    while !holds() {
        assert!(started.elapsed() < Duration::from_secs(60), "timed out: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn pid(child: &Child) -> Pid {
    Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap()
}

fn stop_index(lines: &[RequestRecord]) -> Option<usize> {
    lines.iter().position(|line| line.name == "QUEUE_FORCE_STOP")
}

/// Whether `lines` contain a force stop followed by a clear.
fn contains_stop(lines: &[RequestRecord]) -> bool {
    stop_index(lines).is_some_and(|at| lines[at..].iter().any(|line| line.name == "QUEUE_CLEAR"))
}

/// The arm is at rest, its queue is empty, and only reads follow the stop.
fn assert_stopped(emulator: &ArmEmulator, since: usize) {
    wait_until("force stop and clear arrive", || contains_stop(&emulator.journal()[since..]));
    let state = emulator.state();
    assert!(!state.is_busy && state.n_waiting == 0, "{state:?}");
    let journal = emulator.journal();
    let first_stop = since + stop_index(&journal[since..]).unwrap();
    for line in journal[first_stop..].iter().filter(|line| line.ctrl != 0) {
        assert!(["QUEUE_FORCE_STOP", "QUEUE_CLEAR"].contains(&line.name.as_str()), "{line:?}");
    }
    let pose = emulator.state().planner;
    assert_eq!(pose, emulator.state().planner, "the arm is at rest");
}

/// splitmix64.
fn random(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[test]
fn kill_9_at_any_moment_stops_the_arm() {
    let mut seed = 20_261_121;
    let mut latencies_us = Vec::new();
    let mut n_moving = 0;
    for round in 0..24 {
        let emulator = emulator();
        let mut host = start_host(emulator.port(), "wait");
        // Any moment from the first request to well into the circle.
        let moment = 1 + random(&mut seed) % 90;
        let n_requests = || emulator.journal().len() as u64;
        wait_until("the host sends requests", || n_requests() >= moment);
        let since = emulator.journal().len();
        let was_moving = emulator.state().is_busy;
        let killed = host_clock::now();
        kill_process(pid(&host), Signal::KILL).unwrap();
        host.wait().unwrap();
        assert_stopped(&emulator, since);
        let journal = emulator.journal();
        let stop = &journal[since + stop_index(&journal[since..]).unwrap()];
        latencies_us.push((stop.host_ns - killed.as_nanos()) / 1_000);
        n_moving += i32::from(was_moving);
        assert!(round < 3 || n_moving > 0, "the kills come before any motion: moment {moment}");
    }
    latencies_us.sort_unstable();
    println!("moving at the kill: {n_moving} of 24; kill to force stop in us: {latencies_us:?}");
}

#[test]
fn a_panic_of_the_host_stops_the_arm() {
    for end in ["panic", "panic elsewhere"] {
        let emulator = emulator();
        let mut host = start_host(emulator.port(), end);
        wait_until("the arm moves", || emulator.state().is_busy);
        let since = emulator.journal().len();
        let status = host.wait().unwrap();
        assert_eq!(status.success(), end == "panic elsewhere", "{status}");
        assert_stopped(&emulator, since);
    }
}

/// Whether this process and its children ignore a signal: a background job of a shell ignores
/// SIGINT, and `nohup` ignores SIGHUP.
fn is_ignored(signal: Signal) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal.as_raw() - 1) & 1 == 1
}

#[test]
fn ctrl_c_and_termination_of_the_hosts_group_stop_the_arm() {
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        if is_ignored(signal) {
            eprintln!("skipped: the parent of this test ignores {signal:?}, so the host does too");
            continue;
        }
        let emulator = emulator();
        let mut host = start_host(emulator.port(), "wait");
        wait_until("the arm moves", || emulator.state().is_busy);
        let since = emulator.journal().len();
        // As a terminal does: to the process group of the host, which excludes the guard.
        kill_process_group(pid(&host), signal).unwrap();
        wait_until("the host ends", || host.try_wait().unwrap().is_some());
        assert!(!host.wait().unwrap().success());
        assert_stopped(&emulator, since);
    }
}

#[test]
fn a_missing_heartbeat_of_a_suspended_host_stops_the_arm() {
    let emulator = emulator();
    let mut host = start_host(emulator.port(), "wait");
    wait_until("the arm moves", || emulator.state().is_busy);
    let since = emulator.journal().len();
    kill_process(pid(&host), Signal::STOP).unwrap();
    assert_stopped(&emulator, since);
    kill_process(pid(&host), Signal::KILL).unwrap();
    host.wait().unwrap();
}

#[test]
fn signals_to_the_guard_stop_the_arm_and_do_not_kill_the_guard() {
    for signal in [Signal::INT, Signal::TERM, Signal::HUP, Signal::QUIT] {
        let emulator = emulator();
        let (mut client, _, guard) = client(emulator.port());
        start_circles(&mut client).unwrap();
        wait_until("the arm moves", || emulator.state().is_busy);
        let since = emulator.journal().len();
        kill_process(Pid::from_raw(i32::try_from(guard).unwrap()).unwrap(), signal).unwrap();
        assert_stopped(&emulator, since);
        // It reports the stop, still answers reads and no longer moves the arm.
        assert_eq!(client.pose().unwrap_err(), ArmClientError::Link(LinkError::Stopped));
        client.pose().unwrap();
        assert_eq!(start_circles(&mut client), Err(ArmClientError::Link(LinkError::Stopped)));
    }
}

#[test]
fn the_host_stops_the_arm_itself_when_the_guard_is_killed() {
    let emulator = emulator();
    let (mut client, _, guard) = client(emulator.port());
    start_circles(&mut client).unwrap();
    wait_until("the arm moves", || emulator.state().is_busy);
    let since = emulator.journal().len();
    kill_process(Pid::from_raw(i32::try_from(guard).unwrap()).unwrap(), Signal::KILL).unwrap();
    let error = loop {
        match client.pose() {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    assert!(error.to_string().contains("stopped without it"), "{error}");
    assert_stopped(&emulator, since);
}

#[test]
fn a_halt_from_another_thread_stops_the_arm_permanently() {
    let emulator = emulator();
    let (mut client, stopper, _) = client(emulator.port());
    start_circles(&mut client).unwrap();
    wait_until("the arm moves", || emulator.state().is_busy);
    let since = emulator.journal().len();
    std::thread::spawn(move || stopper.halt().unwrap()).join().unwrap();
    assert_stopped(&emulator, since);
    assert_eq!(start_circles(&mut client), Err(ArmClientError::Link(LinkError::Stopped)));
    client.stop().unwrap();
}

#[test]
fn a_halt_takes_effect_while_the_arm_does_not_answer() {
    let emulator = emulator();
    let (mut client, stopper, _) = client(emulator.port());
    start_circles(&mut client).unwrap();
    emulator.inject("lost-reply@POSE".parse().unwrap());
    emulator.inject("lost-reply@POSE#2".parse().unwrap());
    let since = emulator.journal().len();
    let halting = std::thread::spawn(move || stopper.halt().unwrap());
    while client.pose().is_ok() {}
    halting.join().unwrap();
    assert_stopped(&emulator, since);
}

#[test]
fn an_arm_that_was_unplugged_is_stopped_when_it_is_plugged_in_again() {
    let directory = tempfile::tempdir().unwrap();
    let port = directory.path().join("dobot");
    let mut before = emulator();
    before.link(&port).unwrap();
    let (mut client, _, _) = client(&port);
    start_circles(&mut client).unwrap();
    wait_until("the arm moves", || before.state().is_busy);
    before.inject("unplug".parse().unwrap());
    let error = client.pose().unwrap_err();
    assert!(matches!(error, ArmClientError::Link(LinkError::Gone { .. })), "{error}");
    drop(client);
    // The same name points to a port again, as under /dev/serial/by-id.
    let mut again = emulator();
    again.link(&port).unwrap();
    assert_stopped(&again, 0);
}

#[test]
fn the_guard_reports_why_a_port_cannot_be_opened() {
    let error = GuardLink::start(Path::new(EVRIG), Path::new("/dev/ttyUSB-none")).unwrap_err();
    assert!(error.to_string().contains("there is no port /dev/ttyUSB-none"), "{error}");
    let error = GuardLink::start(Path::new("/no/evrig"), Path::new("/dev/null")).unwrap_err();
    assert!(error.to_string().contains("cannot start /no/evrig"), "{error}");
}

#[test]
fn the_guard_stops_the_arm_when_the_host_exits_normally() {
    let emulator = emulator();
    let (mut client, stopper, _) = client(emulator.port());
    drop(stopper);
    start_circles(&mut client).unwrap();
    wait_until("the arm moves", || emulator.state().is_busy);
    let since = emulator.journal().len();
    drop(client);
    assert_stopped(&emulator, since);
}
