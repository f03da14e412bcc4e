//! A disk that fills up and a limit on memory, in a recording by the program itself.

#![allow(clippy::expect_used, clippy::unwrap_used, unreachable_pub)]
#![cfg(target_os = "linux")]

#[path = "wires/camera.rs"]
#[allow(dead_code)]
mod camera;
#[path = "wires/rig.rs"]
mod rig;

use camera::{Camera, check_events};
use evrig::pi::agent::Agent;
use evrig::pi::source::Synthetic;
use evrig::session::{Session, SessionStatus, verify};
use evrig::sim::arm::{Clock, Emulator, Options};
use rig::rig_on;
use std::path::PathBuf;
use std::process::{Command, Output};

/// Kilobytes of virtual memory: what evrig maps of itself, its threads' stacks and arenas, and both
/// queues, were they full.
const MEMORY_KB: u64 = 3 << 20;

struct Bench {
    emulator: Emulator,
    _agent: Agent,
    camera: Camera,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let options = Options { is_homed: true, ..Options::default() };
        let agent =
            Agent::serve("127.0.0.1:0".parse().unwrap(), Box::new(Synthetic::paced())).unwrap();
        let camera = Camera::start(2);
        let emulator = Emulator::start(options, Clock::Scaled(1.0), Vec::new()).unwrap();
        let bench = Self { emulator, _agent: agent, camera, folder: tempfile::tempdir().unwrap() };
        let pi = bench._agent.address();
        let text = rig_on(bench.emulator.port(), &bench.camera.address, pi);
        std::fs::write(bench.rig(), text).unwrap();
        bench
    }

    fn rig(&self) -> PathBuf {
        self.folder.path().join("rig.toml")
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("session")
    }

    /// Records under a limit of the shell's. A process that writes beyond `-f` is killed, unless it
    /// ignores the signal; then it is refused, as by a full disk.
    fn record(&self, limit: &str) -> Output {
        let script = format!("trap '' XFSZ; ulimit {limit} && exec \"$@\"");
        Command::new("bash")
            .args(["-c", &script, "bash", env!("CARGO_BIN_EXE_evrig"), "record"])
            .arg(self.rig())
            .args(["circle", "--out"])
            .arg(self.out())
            .output()
            .unwrap()
    }
}

#[test]
fn a_disk_that_fills_up_ends_in_a_sealed_session_that_names_the_file() {
    let bench = Bench::new();
    // Kilobytes a file: some seconds of this camera's events, whose file grows by 160 KB a second.
    let recorded = bench.record("-f 400");
    let said = String::from_utf8_lossy(&recorded.stderr).into_owned();
    assert_eq!(recorded.status.code(), Some(1), "{said}");
    assert!(said.contains("File too large") || said.contains("disk full"), "{said}");
    let session = Session::open(&bench.out()).unwrap();
    let manifest = session.manifest();
    assert_eq!(manifest.status, SessionStatus::Aborted);
    let named = |name: &str| manifest.losses.iter().any(|loss| loss.what.contains(name));
    assert!(named("davis.aedat4") || named("rig.mcap"), "{:?}", manifest.losses);
    assert!(verify(&session).unwrap().holds());
    assert!(check_events(&session.layout().davis()) > 0, "what had room is there");
    let arm = bench.emulator.state();
    assert!(!arm.is_busy && arm.n_waiting == 0, "{arm:?}");
}

#[test]
fn a_limit_on_memory_that_the_queues_fit_in_changes_nothing() {
    let bench = Bench::new();
    let recorded = bench.record(&format!("-v {MEMORY_KB}"));
    let said = String::from_utf8_lossy(&recorded.stderr).into_owned();
    assert_eq!(recorded.status.code(), Some(0), "{said}");
    let session = Session::open(&bench.out()).unwrap();
    assert_eq!(session.manifest().status, SessionStatus::Complete);
    assert!(verify(&session).unwrap().holds());
}
