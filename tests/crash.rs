//! A recorder that is killed at any moment leaves a session that is repaired and verifies, in which
//! at most the last second of any stream is missing; the arm is stopped; the series can be taken up.
//!
//! `EVRIG_KILLS` says how often it is killed (8); what each kill cost is printed. The costs are in
//! recorded time: what was sent and is not in the file, times what lies between two of it.

#![allow(clippy::expect_used, clippy::unwrap_used, clippy::print_stderr, unreachable_pub)]

#[path = "wires/camera.rs"]
#[allow(dead_code)]
mod camera;
#[path = "wires/rig.rs"]
mod rig;

use camera::{Camera, EVENT_US, PACKET_EVENTS, check_events};

use evrig::frame::Samples;
use evrig::pi::agent::Agent;
use evrig::pi::source::{FrameSource, SourceError, Synthetic};
use evrig::pi::wire::Settings;
use evrig::pi_camera::PiFrame;
use evrig::session::{Repair, Session, SessionStatus, StreamKind, repair, verify};
use evrig::sim::arm::{Clock, Emulator, Options};
use rig::rig_on;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The last packet of the trajectory after which it is killed: two seconds, well within the circle.
const LAST_PACKET: u64 = 400;
/// So often a recorder is started to be killed at one moment.
const TRIALS: usize = 5;
/// One connection for the preflight, one for the recording.
const CLIENTS: u64 = 2;
/// States in which it is killed, one after another.
const STATES: [&str; 4] = ["start pose", "cameras", "lead-in", "trajectory"];
/// And those behind the trajectory, when there are kills enough.
const LATE_STATES: [&str; 3] = ["tail", "drain", "seal"];
const MANY: usize = 20;
/// So often the series is taken up after a kill.
const RESUMED_EVERY: usize = 8;
const PATIENCE: Duration = Duration::from_secs(120);
/// The promise: the last second of a stream, in its own time.
const MOST_LOST_US: i64 = 1_000_000;
/// Among other tests, which take the recorder's cores from it for seconds.
const MOST_LOST_AMONG_OTHERS_US: i64 = 4_000_000;
const FRAME_US: i64 = 1_000_000 / 120;
const POSE_US: i64 = 1_000_000 / 50;

/// The Pi's camera, and how many frames it has handed over since it was set up.
struct Counted {
    camera: Synthetic,
    n_given: Arc<AtomicU64>,
}

impl FrameSource for Counted {
    fn describe(&self) -> String {
        self.camera.describe()
    }

    fn configure(&mut self, settings: &Settings) -> Result<Settings, SourceError> {
        self.camera.configure(settings)
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        let frame = self.camera.next()?;
        if let Some(frame) = &frame {
            self.n_given.store(frame.metadata.sequence + 1, Ordering::SeqCst);
        }
        Ok(frame)
    }
}

/// Everything that a recorder needs, on real wires.
struct Bench {
    emulator: Emulator,
    agent: Agent,
    n_given: Arc<AtomicU64>,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let options = Options { is_homed: true, ..Options::default() };
        let local = "127.0.0.1:0".parse().unwrap();
        let n_given: Arc<AtomicU64> = Arc::default();
        let camera = Counted { camera: Synthetic::paced(), n_given: Arc::clone(&n_given) };
        Self {
            emulator: Emulator::start(options, Clock::Scaled(1.0), Vec::new()).unwrap(),
            agent: Agent::serve(local, Box::new(camera)).unwrap(),
            n_given,
            folder: tempfile::tempdir().unwrap(),
        }
    }

    /// The folder of the series.
    fn series(&self) -> PathBuf {
        self.folder.path().join("series")
    }

    /// The first session of it.
    fn out(&self) -> PathBuf {
        self.series().join("circle-01")
    }

    /// Poses that the arm was asked for.
    fn n_poses(&self) -> i64 {
        self.emulator.journal().iter().filter(|line| line.name == "POSE").count() as i64
    }

    /// Waits until the guard of a recorder that is gone has stopped the arm, after so many requests.
    fn wait_for_stop(&self, since: usize) {
        let deadline = Instant::now() + PATIENCE;
        let has_stopped = || {
            let journal = self.emulator.journal();
            let mut lines = journal[since.min(journal.len())..].iter();
            lines.any(|line| line.name == "QUEUE_FORCE_STOP")
                && lines.any(|line| line.name == "QUEUE_CLEAR")
        };
        while !has_stopped() {
            assert!(Instant::now() < deadline, "nobody stopped the arm");
            std::thread::sleep(Duration::from_millis(1));
        }
        let state = self.emulator.state();
        assert!(!state.is_busy && state.n_waiting == 0, "{state:?}");
        assert_eq!(state.planner, self.emulator.state().planner, "it stands");
    }

    /// Waits until the recorder is in a state; false when it ended before that.
    fn wait_for_state(&self, recorder: &mut Child, state: &str) -> bool {
        let entered = format!("\"what\":\"{state}\"");
        let deadline = Instant::now() + PATIENCE;
        let journal = self.out().join("journal.jsonl");
        while !std::fs::read_to_string(&journal).is_ok_and(|text| text.contains(&entered)) {
            if recorder.try_wait().unwrap().is_some() {
                return false;
            }
            assert!(Instant::now() < deadline, "the recorder never came to {state}");
            std::thread::sleep(Duration::from_millis(1));
        }
        true
    }

    fn record(&self, camera: &Camera) -> Child {
        self.run(camera, &["--repeat", "1"])
    }

    fn run(&self, camera: &Camera, series: &[&str]) -> Child {
        let text = rig_on(self.emulator.port(), &camera.address, self.agent.address());
        let rig = self.folder.path().join("rig.toml");
        std::fs::write(&rig, text).unwrap();
        Command::new(env!("CARGO_BIN_EXE_evrig"))
            .args(["record", "--quiet"])
            .arg(&rig)
            .args(["circle", "--out"])
            .arg(self.series())
            .args(series)
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    }
}

/// Every raw frame must be the one that its number tells; the number behind the last, 0 for none.
fn check_frames(session: &Session) -> u64 {
    if session.stream(StreamKind::Frames, "raw").is_err() {
        return 0;
    }
    let sequences: Vec<_> =
        session.rig_log_contents().unwrap().metadata.iter().map(|said| said.sequence).collect();
    assert!(sequences.windows(2).all(|pair| pair[0] + 1 == pair[1]), "a frame is missing");
    for (picture, sequence) in session.pi_frames("raw").unwrap().zip(&sequences) {
        let frame = picture.unwrap().frame;
        let Samples::U16(samples) = frame.samples else { panic!("raw frames have 16 bits") };
        let width = usize::from(frame.size.width);
        let differs = |(i, sample): (usize, &u16)| {
            *sample != Synthetic::sample(*sequence, i % width, i / width)
        };
        assert!(!samples.iter().enumerate().any(differs), "frame {sequence} is another");
    }
    sequences.last().map_or(0, |last| last + 1)
}

/// What a kill cost, in recorded time, and what it was.
#[derive(Default)]
struct Costs {
    events_us: i64,
    frames_us: i64,
    poses_us: i64,
}

/// Kills a recorder at a moment, repairs what it left, and says what that cost; none when it ended by
/// itself before, as it does when the machine is too busy to let the simulated arm answer in time.
fn kill_one(bench: &Bench, camera: &mut Camera, killed_in: &str, moment: u64) -> Option<Costs> {
    let mut recorder = bench.record(camera);
    if !bench.wait_for_state(&mut recorder, killed_in) {
        return None;
    }
    let n_poses_before = bench.n_poses();
    camera.wait_for(moment);
    let n_requests = bench.emulator.journal().len();
    let n_given = bench.n_given.load(Ordering::SeqCst);
    let n_poses_asked = bench.n_poses() - n_poses_before;
    if recorder.try_wait().unwrap().is_some() {
        return None;
    }
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let n_sent = camera.n_sent() as i64 * PACKET_EVENTS;
    bench.wait_for_stop(n_requests);
    let out = bench.out();
    let repaired = repair(&out).unwrap();
    let was_sealed = !matches!(repaired, Repair::Resealed(_));
    assert!(!was_sealed || killed_in == "seal", "the recorder was killed in {killed_in}");
    let session = Session::open(&out).unwrap();
    let verification = verify(&session).unwrap();
    assert!(verification.holds(), "after packet {moment}: {:#?}", verification.findings);
    let manifest = session.manifest();
    if !was_sealed {
        assert_eq!(manifest.status, SessionStatus::Recovered);
        assert!(manifest.losses[0].what.contains("cut off in state"), "{:?}", manifest.losses);
    }
    assert!(manifest.recording.as_ref().unwrap().rig.contains("evrig.rig/2"));
    let n_kept = check_events(&session.layout().davis());
    let count = session.stream(StreamKind::Events, "real").map_or(0, |stream| stream.count);
    assert!(n_kept >= count as i64);
    let n_frames = check_frames(&session);
    let n_poses = session.rig_log_contents().map_or(0, |notes| notes.poses.len() as i64);
    // Behind the trajectory the cameras were told to end, and what they send on nobody wants.
    let still_records = !LATE_STATES.contains(&killed_in);
    let lost = |n: i64, each_us: i64| if still_records { n.max(0) * each_us } else { 0 };
    Some(Costs {
        events_us: lost(n_sent - n_kept, EVENT_US),
        frames_us: lost(n_given as i64 - n_frames as i64, FRAME_US),
        poses_us: lost(n_poses_asked - n_poses, POSE_US),
    })
}

#[test]
fn a_recorder_killed_at_any_moment_loses_a_second_at_most_and_the_series_goes_on() {
    let n_kills: usize = std::env::var("EVRIG_KILLS").map_or(8, |n| n.parse().expect("a number"));
    // A run of many kills is the measurement, and has the machine to itself.
    let promised_us = if n_kills >= MANY { MOST_LOST_US } else { MOST_LOST_AMONG_OTHERS_US };
    let states: Vec<&str> = if n_kills >= MANY {
        STATES.into_iter().chain(LATE_STATES).collect()
    } else {
        STATES.to_vec()
    };
    let mut state = 20_261_121_u64;
    let (mut most, mut n_counted, mut n_resumed) = (Costs::default(), 0, 0);
    for kill in 0..n_kills {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        // One kill in every state, the others somewhere on the trajectory.
        let killed_in = states.get(kill).copied().unwrap_or("trajectory");
        let moment = if kill < states.len() { 0 } else { 1 + (state >> 33) % LAST_PACKET };
        let mut trials = (0..TRIALS).map(|_| {
            let (bench, mut camera) = (Bench::new(), Camera::start(CLIENTS));
            let costs = kill_one(&bench, &mut camera, killed_in, moment)?;
            Some((bench, camera, costs))
        });
        let tried = trials.find_map(|tried| tried);
        let (bench, camera, costs) = tried.expect("the recorder lives until it is killed");
        eprintln!(
            "killed in {killed_in} after {moment} packets: lost {:.0} ms of events, {:.0} of frames, \
             {:.0} of poses",
            costs.events_us as f64 * 1e-3,
            costs.frames_us as f64 * 1e-3,
            costs.poses_us as f64 * 1e-3,
        );
        // Before the trajectory the cameras' first samples may not have been taken yet.
        if killed_in == "trajectory" {
            let all = [costs.events_us, costs.frames_us, costs.poses_us];
            assert!(all.iter().all(|lost_us| *lost_us <= promised_us), "lost, in us: {all:?}");
            most.events_us = most.events_us.max(costs.events_us);
            most.frames_us = most.frames_us.max(costs.frames_us);
            most.poses_us = most.poses_us.max(costs.poses_us);
            n_counted += 1;
        }
        if kill % RESUMED_EVERY == RESUMED_EVERY - 1 {
            // The first try of the session was killed, so this is the second; on a machine too busy for
            // the simulated arm to answer in time it ends by itself, and is taken up again.
            let again = (2..2 + TRIALS).find_map(|trial| {
                let resumed = bench.run(&camera, &["--resume"]).wait().unwrap();
                let name = format!("circle-01-again-{trial}");
                let again = Session::open(&bench.series().join(name)).unwrap();
                assert!(verify(&again).unwrap().holds());
                let is_complete = again.manifest().status == SessionStatus::Complete;
                assert_eq!(is_complete, [Some(0), Some(3)].contains(&resumed.code()));
                is_complete.then_some(())
            });
            assert!(again.is_some(), "taken up {TRIALS} times, and never completed");
            n_resumed += 1;
        }
        camera.end();
    }
    eprintln!(
        "{n_kills} kills, {n_counted} on the trajectory; most lost there: {:.0} ms of events, {:.0} ms \
         of frames, {:.0} ms of poses; {n_resumed} series taken up and completed",
        most.events_us as f64 * 1e-3,
        most.frames_us as f64 * 1e-3,
        most.poses_us as f64 * 1e-3,
    );
}

#[test]
fn what_arrived_is_in_the_file_though_nothing_follows_it() {
    let bench = Bench::new();
    let mut camera = Camera::start(CLIENTS);
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
    let mut camera = Camera::start(CLIENTS);
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
