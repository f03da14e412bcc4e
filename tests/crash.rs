//! A recorder that is killed at any moment leaves a session that is repaired and verifies.
//!
//! `EVRIG_KILLS` says how often it is killed (8); what each kill cost is printed.

#![allow(clippy::expect_used, clippy::unwrap_used, clippy::print_stderr)]

use evrig::device::davis::serve::StreamServer;
use evrig::device::pi::agent::Agent;
use evrig::device::pi::source::Synthetic;
use evrig::device::sim::arm::{Clock, Emulator, Options};
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, Content, Reader, StreamSpec};
use evrig::geometry::Size;
use evrig::rig::Rig;
use evrig::session::{Repair, Session, Status, StreamKind, repair, verify};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Events come 100 us apart, in packets of 5 ms.
const EVENT_US: i64 = 100;
const PACKET_EVENTS: i64 = 50;
const PACKET: Duration = Duration::from_millis(5);
/// The last packet of the trajectory after which it is killed: two seconds, well within the circle.
const LAST_PACKET: u64 = 400;
/// States in which it is killed, one after another.
const STATES: [&str; 4] = ["start pose", "cameras", "lead-in", "trajectory"];
const PATIENCE: Duration = Duration::from_secs(120);

/// The event whose number its stamp tells.
fn event(n: i64) -> Event {
    let place = n.unsigned_abs() as usize;
    Event {
        t: n * EVENT_US,
        x: (place % 346) as u16,
        y: (place / 346 % 260) as u16,
        on: n % 3 == 0,
    }
}

/// An event camera that tells of every packet it has sent to the recording.
struct Camera {
    address: String,
    sent: Receiver<u64>,
    n_sent: u64,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Camera {
    fn start() -> Self {
        let spec = StreamSpec::events(Size::DAVIS346, "DAVIS346_1");
        let mut server = StreamServer::bind("127.0.0.1:0", &spec, Compression::None).unwrap();
        let address = server.address().to_string();
        let (tell, sent) = channel();
        let (stop, stopped) = channel::<()>();
        let thread = std::thread::spawn(move || {
            // One connection for the preflight, one for the recording.
            if !server.wait_for_clients(2, PATIENCE) {
                return;
            }
            for packet in 0.. {
                let first = packet * PACKET_EVENTS;
                let events: Events = (first..first + PACKET_EVENTS).map(event).collect();
                server.send_events(events.as_slice()).unwrap();
                if tell.send(packet as u64 + 1).is_err()
                    || stopped.recv_timeout(PACKET) != Err(RecvTimeoutError::Timeout)
                {
                    return;
                }
            }
        });
        Self { address, sent, n_sent: 0, stop: Some(stop), thread: Some(thread) }
    }

    /// Waits until so many more packets were sent.
    fn wait_for(&mut self, n: u64) {
        self.n_sent = self.sent.try_iter().last().unwrap_or(self.n_sent);
        let goal = self.n_sent + n;
        while self.n_sent < goal {
            self.n_sent = self.sent.recv_timeout(PATIENCE).expect("the recorder takes packets");
        }
    }

    /// Stops, and says how many packets were sent.
    fn end(mut self) -> u64 {
        drop(self.stop.take());
        self.thread.take().unwrap().join().unwrap();
        self.sent.try_iter().last().unwrap_or(self.n_sent)
    }
}

/// Everything that a recorder needs, on real wires.
struct Bench {
    emulator: Emulator,
    agent: Agent,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let options = Options { is_homed: true, ..Options::default() };
        let local = "127.0.0.1:0".parse().unwrap();
        Self {
            emulator: Emulator::start(options, Clock::Scaled(1.0), Vec::new()).unwrap(),
            agent: Agent::serve(local, Box::new(Synthetic::paced())).unwrap(),
            folder: tempfile::tempdir().unwrap(),
        }
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("session")
    }

    /// Waits until the recorder is in a state.
    fn wait_for_state(&self, state: &str) {
        let entered = format!("\"what\":\"{state}\"");
        let deadline = Instant::now() + PATIENCE;
        let journal = self.out().join("journal.jsonl");
        while !std::fs::read_to_string(&journal).is_ok_and(|text| text.contains(&entered)) {
            assert!(Instant::now() < deadline, "the recorder never came to {state}");
            std::thread::yield_now();
        }
    }

    fn record(&self, camera: &Camera) -> Child {
        let text = Rig::simulated().unwrap().text;
        let change = |text: String, from: &str, to: String| {
            assert!(text.contains(from), "{from}");
            text.replacen(from, &to, 1)
        };
        let port = format!("port = {:?}", self.emulator.port());
        let text = change(text, "port = \"sim\"", port);
        let sim = "transport = \"sim\"";
        let text = change(text, sim, format!("transport = \"tcp://{}\"", camera.address));
        let text = change(text, sim, format!("transport = \"tcp://{}\"", self.agent.address()));
        let text = change(text, "size_px = [692, 520]", "size_px = [64, 48]".into());
        let rig = self.folder.path().join("rig.toml");
        std::fs::write(&rig, text).unwrap();
        Command::new(env!("CARGO_BIN_EXE_evrig"))
            .args(["record", "--quiet"])
            .arg(&rig)
            .args(["circle", "--out"])
            .arg(self.out())
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    }
}

/// The recorded events, each of which must be the one its stamp tells, without a gap between them;
/// the number behind the last, 0 for none.
fn check_events(path: &Path) -> i64 {
    let mut next: Option<i64> = None;
    for packet in Reader::open(path).into_iter().flatten().map_while(Result::ok) {
        let Content::Events(events) = packet.content else { panic!("events were sent") };
        for found in events.as_slice().iter() {
            let n = next.unwrap_or(found.t / EVENT_US);
            assert_eq!(found, event(n), "event {n} is not the one that was sent");
            next = Some(n + 1);
        }
    }
    next.unwrap_or(0)
}

#[test]
fn a_recorder_killed_at_any_moment_leaves_a_session_that_is_repaired_and_verifies() {
    let n_kills: usize = std::env::var("EVRIG_KILLS").map_or(8, |n| n.parse().expect("a number"));
    let mut state = 20_261_121_u64;
    let mut costs = Vec::new();
    for kill in 0..n_kills {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        // One kill in every state, the others somewhere on the trajectory.
        let killed_in = STATES.get(kill).copied().unwrap_or("trajectory");
        let moment = if kill < STATES.len() { 0 } else { 1 + (state >> 33) % LAST_PACKET };
        let bench = Bench::new();
        let mut camera = Camera::start();
        let mut recorder = bench.record(&camera);
        bench.wait_for_state(killed_in);
        camera.wait_for(moment);
        recorder.kill().unwrap();
        recorder.wait().unwrap();
        let n_sent = camera.end() as i64 * PACKET_EVENTS;
        let out = bench.out();
        let repaired = repair(&out).unwrap();
        assert!(matches!(repaired, Repair::Resealed(_)), "the recorder was killed");
        let session = Session::open(&out).unwrap();
        let verification = verify(&session).unwrap();
        assert!(verification.holds(), "after packet {moment}: {:#?}", verification.findings);
        let manifest = session.manifest();
        assert_eq!(manifest.status, Status::Recovered);
        assert!(manifest.losses[0].what.contains("cut off in state"), "{:?}", manifest.losses);
        assert!(manifest.recording.as_ref().unwrap().rig.contains("evrig.rig/1"));
        let n_kept = check_events(&session.layout().davis());
        let count = session.stream(StreamKind::Events, "real").map_or(0, |stream| stream.count);
        assert!(n_kept >= count as i64);
        let lost_us = (n_sent - n_kept) * EVENT_US;
        eprintln!(
            "killed in {killed_in} after {moment} packets of it: {n_kept} of {n_sent} events kept, \
             {:.0} ms lost",
            lost_us as f64 * 1e-3,
        );
        // Before the trajectory the cameras' first samples may not have been taken yet.
        if killed_in == "trajectory" {
            assert!(n_kept > 0, "events that came before the trajectory are in the file");
            costs.push(lost_us);
        }
    }
    let longest = costs.iter().max().copied().unwrap_or(0);
    eprintln!("{n_kills} kills, {} on the trajectory; most lost there: {longest} us", costs.len());
}

#[test]
fn what_arrived_is_in_the_file_though_nothing_follows_it() {
    let bench = Bench::new();
    let mut camera = Camera::start();
    let mut recorder = bench.record(&camera);
    camera.wait_for(1);
    // Far less than a buffer, and then silence.
    let n_sent = camera.end() as i64 * PACKET_EVENTS;
    let path = bench.out().join("davis.aedat4");
    let deadline = Instant::now() + PATIENCE;
    while check_events(&path) < n_sent {
        assert!(Instant::now() < deadline, "{} of {n_sent} events", check_events(&path));
        std::thread::yield_now();
    }
    recorder.kill().unwrap();
    recorder.wait().unwrap();
}

#[test]
fn verify_repair_says_what_was_lost_and_ends_with_losses() {
    let bench = Bench::new();
    let mut camera = Camera::start();
    let mut recorder = bench.record(&camera);
    camera.wait_for(100);
    let evrig = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_evrig"));
        command.arg("verify").arg(bench.out()).args(arguments).output().unwrap()
    };
    let alive = evrig(&["--repair"]);
    assert_eq!(alive.status.code(), Some(1));
    let said = String::from_utf8(alive.stderr).unwrap();
    assert!(said.contains("being recorded by another evrig"), "{said}");
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    camera.end();
    let unsealed = evrig(&[]);
    assert_eq!(unsealed.status.code(), Some(1));
    assert!(String::from_utf8(unsealed.stderr).unwrap().contains("--repair"));
    let repaired = evrig(&["--repair", "--json"]);
    assert_eq!(repaired.status.code(), Some(3), "{repaired:?}");
    let value: serde_json::Value = serde_json::from_slice(&repaired.stdout).unwrap();
    assert_eq!((&value["status"], &value["repaired"]), (&"recovered".into(), &true.into()));
    assert!(value["losses"][0]["what"].as_str().unwrap().contains("cut off in state"), "{value}");
    let again = evrig(&["--repair", "--json"]);
    let value: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!(value["repaired"], false);
}
