//! The command `evrig emulate arm`.

use assert_cmd::Command as Tool;
use evrig::device::dobot::{ArmClient, ArmTimeouts, port};
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

const EVRIG: &str = env!("CARGO_BIN_EXE_evrig");

#[test]
fn the_emulator_answers_at_its_link_until_ctrl_c_and_removes_the_link() {
    let directory = tempfile::tempdir().unwrap();
    let link = directory.path().join("dobot");
    let journal = directory.path().join("arm.jsonl");
    // An older link is replaced.
    std::os::unix::fs::symlink("/nowhere", &link).unwrap();
    let mut child = Command::new(EVRIG)
        .args(["emulate", "arm", "--link"])
        .arg(&link)
        .arg("--journal")
        .arg(&journal)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut printed = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut printed).unwrap();
    assert_eq!(Path::new(printed.trim()), link);
    let serial = port::open(&link).unwrap();
    let mut client = ArmClient::new(Box::new(serial), ArmTimeouts::default());
    assert_eq!(client.identify().unwrap().firmware, "3.7.0");
    kill_process(Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap(), Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(link.symlink_metadata().is_err(), "the link is removed");
    let lines = std::fs::read_to_string(journal).unwrap();
    let first: serde_json::Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    assert_eq!(first["name"], "DEVICE_VERSION");
    assert!(client.pose().unwrap_err().to_string().contains("is gone"));
}

#[test]
fn invalid_options_are_refused_with_the_valid_values() {
    for (options, expected) in [
        (&["--fault", "lost-answer"][..], "lost-reply"),
        (&["--time-scale", "0"][..], "0 < X"),
        (&["--journal", "/no/such/place"][..], "/no/such/place"),
    ] {
        let ran = Tool::new(EVRIG).args(["emulate", "arm"]).args(options).assert().failure();
        let error = String::from_utf8_lossy(&ran.get_output().stderr).into_owned();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_link_does_not_replace_a_file() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let ran = Tool::new(EVRIG).args(["emulate", "arm", "--link"]).arg(file.path()).assert();
    let output = ran.failure().code(1);
    let error = String::from_utf8_lossy(&output.get_output().stderr).into_owned();
    assert!(error.contains(file.path().to_str().unwrap()), "{error}");
    assert!(file.path().exists());
}
