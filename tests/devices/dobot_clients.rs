//! The simulated arm is proven by clients that others wrote.
//!
//! `EVRIG_PYTHON` names a Python that has pydobot 1.3.2 and pydobotplus 0.1.2; without it
//! the test says that it was skipped.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// An emulator that is killed with the test.
struct Emulated(Child);

impl Drop for Emulated {
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
        .map(Emulated)
        .unwrap();
    let mut port = String::new();
    BufReader::new(emulated.0.stdout.take().unwrap()).read_line(&mut port).unwrap();
    let ran = Command::new(python)
        .arg("tests/python/dobot_clients.py")
        .arg(port.trim())
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{words}");
    // The clients print remarks of their own; ours is the last line.
    let said = String::from_utf8_lossy(&ran.stdout);
    let poses: serde_json::Value =
        serde_json::from_str(said.lines().last().unwrap_or_default()).expect(&said);
    // The arm wakes at its factory pose (0, 45, 45, 0) with the suction cup's offset.
    let x = poses["pydobot"]["start"][0].as_f64().unwrap();
    assert!((x - 259.104).abs() < 1e-3, "{poses}");
    let journal = std::fs::read_to_string(journal).unwrap();
    let n_moves = journal.lines().filter(|line| line.contains("\"name\":\"PTP\"")).count();
    assert_eq!(n_moves, 2);
}
