//! A full disk and a memory limit in a recording by the program.

use crate::camera::{NumberedCamera, check_events};
use crate::rig::rig_on;
use evrig::pi::agent::Agent;
use evrig::pi::source::Synthetic;
use evrig::session::{Session, SessionStatus, verify};
use evrig::sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use std::path::PathBuf;
use std::process::{Command, Output};

/// Kilobytes of virtual memory: the mapped program, the stacks and arenas of its threads, and both
/// queues when full.
const MEMORY_KB: u64 = 3 << 20;

struct DiskSetup {
    emulator: ArmEmulator,
    _agent: Agent,
    camera: NumberedCamera,
    folder: tempfile::TempDir,
}

impl DiskSetup {
    fn new() -> Self {
        let options = ArmOptions { is_homed: true, ..ArmOptions::default() };
        let agent =
            Agent::serve("127.0.0.1:0".parse().unwrap(), Box::new(Synthetic::paced())).unwrap();
        let camera = NumberedCamera::start(2);
        let emulator = ArmEmulator::start(options, ArmClock::Scaled(1.0), Vec::new()).unwrap();
        let setup = Self { emulator, _agent: agent, camera, folder: tempfile::tempdir().unwrap() };
        let pi = setup._agent.address();
        let text = rig_on(setup.emulator.port(), &setup.camera.address, pi);
        std::fs::write(setup.rig(), text).unwrap();
        setup
    }

    fn rig(&self) -> PathBuf {
        self.folder.path().join("rig.toml")
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("session")
    }

    /// Records under a limit set by the shell. A process that ignores SIGXFSZ gets an error from a
    /// write beyond `-f`, as on a full disk.
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
fn a_full_disk_ends_in_a_sealed_session_that_names_the_file() {
    let setup = DiskSetup::new();
    // Kilobytes per file: some seconds of events, at 160 KB per second.
    let recorded = setup.record("-f 400");
    let stderr = String::from_utf8_lossy(&recorded.stderr).into_owned();
    assert_eq!(recorded.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("File too large") || stderr.contains("disk full"), "{stderr}");
    let session = Session::open(&setup.out()).unwrap();
    let manifest = session.manifest();
    assert_eq!(manifest.status, SessionStatus::Aborted);
    let named = |name: &str| manifest.losses.iter().any(|loss| loss.what.contains(name));
    assert!(named("davis.aedat4") || named("rig.mcap"), "{:?}", manifest.losses);
    assert!(verify(&session).unwrap().holds());
    assert!(check_events(&session.layout().davis()) > 0, "earlier events are in the file");
    let arm = setup.emulator.state();
    assert!(!arm.is_busy && arm.n_waiting == 0, "{arm:?}");
}

#[test]
fn a_memory_limit_above_the_queue_size_changes_nothing() {
    let setup = DiskSetup::new();
    let recorded = setup.record(&format!("-v {MEMORY_KB}"));
    let stderr = String::from_utf8_lossy(&recorded.stderr).into_owned();
    assert_eq!(recorded.status.code(), Some(0), "{stderr}");
    let session = Session::open(&setup.out()).unwrap();
    assert_eq!(session.manifest().status, SessionStatus::Complete);
    assert!(verify(&session).unwrap().holds());
}
