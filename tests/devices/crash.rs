//! A recorder that is killed at any moment leaves a session that can be repaired and verifies. At
//! most the last second of any stream is missing, the arm is stopped, and the series can be
//! resumed.
//!
//! `EVRIG_KILLS` sets the number of kills (default 8). The loss of each kill is printed in recorded
//! time: the number of samples sent and not in the file, times their period.

use crate::camera::{EVENT_US, NumberedCamera, PACKET_EVENTS, check_events};

use crate::rig::rig_on;
use evrig::frame::Samples;
use evrig::pi::agent::Agent;
use evrig::pi::order::CaptureSettings;
use evrig::pi::source::{FrameSource, SourceError, Synthetic};
use evrig::pi_camera::PiFrame;
use evrig::session::{Repair, Session, SessionStatus, StreamKind, repair, verify};
use evrig::sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Latest packet of the trajectory after which it is killed: two seconds, well within the circle.
const MAX_PACKET: u64 = 400;
/// Attempts to start a recorder that lives until one moment.
const MAX_ATTEMPTS: usize = 5;
/// One connection for the preflight, one for the recording.
const CLIENTS: u64 = 2;
/// States in which it is killed, one after another.
const STATES: [&str; 4] = ["start pose", "cameras", "lead-in", "trajectory"];
/// States after the trajectory, used when there are enough kills.
const LATE_STATES: [&str; 3] = ["tail", "drain", "seal"];
/// Kills from which on a run counts as a measurement.
const MEASUREMENT_KILLS: usize = 20;
/// The series is resumed after every kill of this number.
const RESUMED_EVERY: usize = 8;
const PATIENCE: Duration = Duration::from_secs(120);
/// Guaranteed bound: the last second of a stream, in its own time.
const MAX_LOST_US: i64 = 1_000_000;
/// Bound next to other tests, which occupy the recorder's cores for seconds.
const MAX_LOST_SHARED_US: i64 = 4_000_000;
const FRAME_US: i64 = 1_000_000 / 120;
const POSE_US: i64 = 1_000_000 / 50;

/// The Pi's camera with the number of frames it has delivered since it was configured.
struct CountedSource {
    camera: Synthetic,
    n_given: Arc<AtomicU64>,
}

impl FrameSource for CountedSource {
    fn describe(&self) -> String {
        self.camera.describe()
    }

    fn configure(&mut self, settings: &CaptureSettings) -> Result<CaptureSettings, SourceError> {
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

/// The devices of a recorder, on their real protocols.
struct CrashSetup {
    emulator: ArmEmulator,
    agent: Agent,
    n_given: Arc<AtomicU64>,
    folder: tempfile::TempDir,
}

impl CrashSetup {
    fn new() -> Self {
        let options = ArmOptions { is_homed: true, ..ArmOptions::default() };
        let local = "127.0.0.1:0".parse().unwrap();
        let n_given: Arc<AtomicU64> = Arc::default();
        let camera = CountedSource { camera: Synthetic::paced(), n_given: Arc::clone(&n_given) };
        Self {
            emulator: ArmEmulator::start(options, ArmClock::Scaled(1.0), Vec::new()).unwrap(),
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

    /// Poses requested from the arm.
    fn n_poses(&self) -> i64 {
        self.emulator.journal().iter().filter(|line| line.name == "POSE").count() as i64
    }

    /// Waits until the guard of a dead recorder has stopped the arm, after `since` requests.
    fn wait_for_stop(&self, since: usize) {
        let deadline = Instant::now() + PATIENCE;
        let has_stopped = || {
            let journal = self.emulator.journal();
            let mut lines = journal[since.min(journal.len())..].iter();
            lines.any(|line| line.name == "QUEUE_FORCE_STOP")
                && lines.any(|line| line.name == "QUEUE_CLEAR")
        };
        while !has_stopped() {
            assert!(Instant::now() < deadline, "the arm was not stopped");
            std::thread::sleep(Duration::from_millis(1));
        }
        let state = self.emulator.state();
        assert!(!state.is_busy && state.n_waiting == 0, "{state:?}");
        assert_eq!(state.planner, self.emulator.state().planner, "the arm is at rest");
    }

    /// Waits until the recorder is in a state; false if it ended before.
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

    fn record(&self, camera: &NumberedCamera) -> Child {
        self.run(camera, &["--repeat", "1"])
    }

    fn run(&self, camera: &NumberedCamera, series: &[&str]) -> Child {
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

/// Requires that every raw frame matches its number. Returns the number after the last, 0 for none.
fn check_frames(session: &Session) -> u64 {
    if session.stream(StreamKind::Frames, "raw").is_err() {
        return 0;
    }
    let sequences: Vec<_> = session
        .rig_log_contents()
        .unwrap()
        .metadata
        .iter()
        .map(|metadata| metadata.sequence)
        .collect();
    assert!(sequences.windows(2).all(|pair| pair[0] + 1 == pair[1]), "a frame is missing");
    for (image, sequence) in session.pi_frames("raw").unwrap().zip(&sequences) {
        let frame = image.unwrap().frame;
        let Samples::U16(samples) = frame.samples else { panic!("raw frames have 16 bits") };
        let width = usize::from(frame.size.width);
        let differs = |(i, sample): (usize, &u16)| {
            *sample != Synthetic::sample(*sequence, i % width, i / width)
        };
        assert!(!samples.iter().enumerate().any(differs), "frame {sequence} has other samples");
    }
    sequences.last().map_or(0, |last| last + 1)
}

/// Data lost by a kill, in recorded time.
#[derive(Default)]
struct Losses {
    events_us: i64,
    frames_us: i64,
    poses_us: i64,
}

/// Kills a recorder at a moment, repairs its session and returns the losses; none if it ended by
/// itself before, which happens when the machine is too busy for the simulated arm to answer in
/// time.
fn kill_one(
    setup: &CrashSetup,
    camera: &mut NumberedCamera,
    killed_in: &str,
    moment: u64,
) -> Option<Losses> {
    let mut recorder = setup.record(camera);
    if !setup.wait_for_state(&mut recorder, killed_in) {
        return None;
    }
    let n_poses_before = setup.n_poses();
    camera.wait_for(moment);
    let n_requests = setup.emulator.journal().len();
    let n_given = setup.n_given.load(Ordering::SeqCst);
    let n_poses_asked = setup.n_poses() - n_poses_before;
    if recorder.try_wait().unwrap().is_some() {
        return None;
    }
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let n_sent = camera.n_sent() as i64 * PACKET_EVENTS;
    setup.wait_for_stop(n_requests);
    let out = setup.out();
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
    // After the trajectory the cameras are stopped, and later samples do not count.
    let still_records = !LATE_STATES.contains(&killed_in);
    let lost = |n: i64, each_us: i64| if still_records { n.max(0) * each_us } else { 0 };
    Some(Losses {
        events_us: lost(n_sent - n_kept, EVENT_US),
        frames_us: lost(n_given as i64 - n_frames as i64, FRAME_US),
        poses_us: lost(n_poses_asked - n_poses, POSE_US),
    })
}

#[test]
fn a_recorder_killed_at_any_moment_loses_at_most_a_second_and_the_series_can_be_resumed() {
    let n_kills: usize = std::env::var("EVRIG_KILLS").map_or(8, |n| n.parse().expect("a number"));
    // A run of many kills is a measurement without other tests beside it.
    let bound_us = if n_kills >= MEASUREMENT_KILLS { MAX_LOST_US } else { MAX_LOST_SHARED_US };
    let states: Vec<&str> = if n_kills >= MEASUREMENT_KILLS {
        STATES.into_iter().chain(LATE_STATES).collect()
    } else {
        STATES.to_vec()
    };
    let mut state = 20_261_121_u64;
    let (mut most, mut n_counted, mut n_resumed) = (Losses::default(), 0, 0);
    for kill in 0..n_kills {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        // One kill in every state, the others somewhere on the trajectory.
        let killed_in = states.get(kill).copied().unwrap_or("trajectory");
        let moment = if kill < states.len() { 0 } else { 1 + (state >> 33) % MAX_PACKET };
        let mut trials = (0..MAX_ATTEMPTS).map(|_| {
            let (setup, mut camera) = (CrashSetup::new(), NumberedCamera::start(CLIENTS));
            let costs = kill_one(&setup, &mut camera, killed_in, moment)?;
            Some((setup, camera, costs))
        });
        let tried = trials.find_map(|tried| tried);
        let (setup, camera, costs) = tried.expect("the recorder runs until it is killed");
        eprintln!(
            "killed in {killed_in} after {moment} packets: lost {:.0} ms of events, {:.0} of frames, \
             {:.0} of poses",
            costs.events_us as f64 * 1e-3,
            costs.frames_us as f64 * 1e-3,
            costs.poses_us as f64 * 1e-3,
        );
        // Before the trajectory the first samples may not have been read yet.
        if killed_in == "trajectory" {
            let all = [costs.events_us, costs.frames_us, costs.poses_us];
            assert!(all.iter().all(|lost_us| *lost_us <= bound_us), "lost, in us: {all:?}");
            most.events_us = most.events_us.max(costs.events_us);
            most.frames_us = most.frames_us.max(costs.frames_us);
            most.poses_us = most.poses_us.max(costs.poses_us);
            n_counted += 1;
        }
        if kill % RESUMED_EVERY == RESUMED_EVERY - 1 {
            // The first attempt was killed, so this is the second. On a machine too busy for the
            // simulated arm to answer in time it ends by itself and is resumed again.
            let again = (2..2 + MAX_ATTEMPTS).find_map(|trial| {
                let resumed = setup.run(&camera, &["--resume"]).wait().unwrap();
                let name = format!("circle-01-again-{trial}");
                let again = Session::open(&setup.series().join(name)).unwrap();
                assert!(verify(&again).unwrap().holds());
                let is_complete = again.manifest().status == SessionStatus::Complete;
                assert_eq!(is_complete, [Some(0), Some(3)].contains(&resumed.code()));
                is_complete.then_some(())
            });
            assert!(again.is_some(), "resumed {MAX_ATTEMPTS} times without completing");
            n_resumed += 1;
        }
        camera.end();
    }
    eprintln!(
        "{n_kills} kills, {n_counted} on the trajectory; largest losses there: {:.0} ms of events, {:.0} ms \
         of frames, {:.0} ms of poses; {n_resumed} series resumed and completed",
        most.events_us as f64 * 1e-3,
        most.frames_us as f64 * 1e-3,
        most.poses_us as f64 * 1e-3,
    );
}

#[test]
fn events_are_written_on_arrival_without_waiting_for_more() {
    let setup = CrashSetup::new();
    let mut camera = NumberedCamera::start(CLIENTS);
    let mut recorder = setup.record(&camera);
    camera.wait_for(1);
    // Far less than a buffer, then nothing.
    let n_sent = camera.end() as i64 * PACKET_EVENTS;
    let path = setup.out().join("davis.aedat4");
    let deadline = Instant::now() + PATIENCE;
    while check_events(&path) < n_sent {
        assert!(Instant::now() < deadline, "{} of {n_sent} events", check_events(&path));
        std::thread::yield_now();
    }
    recorder.kill().unwrap();
    recorder.wait().unwrap();
}

#[test]
fn verify_repair_reports_the_losses_and_exits_with_3() {
    let setup = CrashSetup::new();
    let mut camera = NumberedCamera::start(CLIENTS);
    let mut recorder = setup.record(&camera);
    camera.wait_for(100);
    let evrig = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_evrig"));
        command.arg("verify").arg(setup.out()).args(arguments).output().unwrap()
    };
    let alive = evrig(&["--repair"]);
    assert_eq!(alive.status.code(), Some(1));
    let stderr = String::from_utf8(alive.stderr).unwrap();
    assert!(stderr.contains("being recorded by another evrig"), "{stderr}");
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
