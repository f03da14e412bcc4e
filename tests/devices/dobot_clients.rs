//! Third-party clients drive the simulated arm.
//!
//! Needs a Python with pydobot 1.3.2 and pydobotplus 0.1.2, named by `EVRIG_PYTHON`; skipped when
//! unset.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// An emulator process, killed when dropped.
struct EmulatorProcess(Child);

impl Drop for EmulatorProcess {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn pydobot_and_pydobotplus_read_the_pose_and_complete_moves() {
    let Ok(python) = std::env::var("EVRIG_PYTHON") else {
        eprintln!("SKIPPED: set EVRIG_PYTHON to a Python with pydobot and pydobotplus");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let journal = directory.path().join("arm.jsonl");
    let mut emulated = Command::new(env!("CARGO_BIN_EXE_evrig"))
        .args(["emulate", "arm", "--time-scale", "20", "--journal"])
        .arg(&journal)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map(EmulatorProcess)
        .unwrap();
    let mut port = String::new();
    BufReader::new(emulated.0.stdout.take().unwrap()).read_line(&mut port).unwrap();
    let ran = Command::new(python)
        .arg("tests/python/dobot_clients.py")
        .arg(port.trim())
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{stderr}");
    // The clients print messages of their own; the result is the last line.
    let printed = String::from_utf8_lossy(&ran.stdout);
    let poses: serde_json::Value =
        serde_json::from_str(printed.lines().last().unwrap_or_default()).expect(&printed);
    // The arm starts at its factory pose (0, 45, 45, 0) with the offset of the suction cup.
    let x = poses["pydobot"]["start"][0].as_f64().unwrap();
    assert!((x - 259.104).abs() < 1e-3, "{poses}");
    let journal = std::fs::read_to_string(journal).unwrap();
    let n_moves = journal.lines().filter(|line| line.contains("\"name\":\"PTP\"")).count();
    assert_eq!(n_moves, 2);
}
