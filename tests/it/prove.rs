//! The command `evrig prove` on the real recording: files of a run, and resuming it.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

const STREET: &str = "tests/data/davis346-street.aedat4";

fn evrig(arguments: &[&str], out: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_evrig"))
        .args(["prove", "--json", "--out"])
        .arg(out)
        .args(arguments)
        .output()
        .unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Trials stopped before they answer: everything except the diagnosis itself.
const STOPPED: &[&str] = &["--recording", STREET, "--single", "2", "--deadline", "0.000001"];

#[test]
fn a_run_keeps_its_records_is_not_overwritten_and_resumes_with_its_own_plan() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("proof");
    let none = evrig(&[STOPPED, &["--resume"]].concat(), &out);
    assert_eq!(none.status.code(), Some(1));
    assert!(stderr(&none).contains("holds no run to resume"), "{}", stderr(&none));

    let first = evrig(STOPPED, &out);
    assert!(first.status.success(), "{}", stderr(&first));
    let value: Value = serde_json::from_slice(&first.stdout).unwrap();
    assert_eq!(value["proof"]["score"]["n"], 2);
    assert_eq!(value["proof"]["score"]["unanswered"], 2, "a timeout is not an answer");
    for name in ["plan.json", "proof-plasmode.json", "proof-plasmode.md"] {
        assert!(out.join(name).exists(), "{name}");
    }
    for trial in ["plasmode-as-it-is", "plasmode-000", "plasmode-001"] {
        assert!(out.join("trials").join(trial).with_extension("json").exists(), "{trial}");
        assert!(!out.join("sessions").join(trial).exists(), "{trial}: removed after scoring");
    }

    let again = evrig(STOPPED, &out);
    assert_eq!(again.status.code(), Some(1));
    assert!(stderr(&again).contains("--resume"), "{}", stderr(&again));
    let other = evrig(&[STOPPED, &["--resume", "--seed", "9"]].concat(), &out);
    assert_eq!(other.status.code(), Some(1));
    assert!(
        stderr(&other).contains("`seed` is 1 in the folder and 9 in this call"),
        "{}",
        stderr(&other)
    );

    // A killed run lacks at most the record of one trial.
    std::fs::remove_file(out.join("trials/plasmode-001.json")).unwrap();
    let resumed = evrig(&[STOPPED, &["--resume"]].concat(), &out);
    assert!(resumed.status.success(), "{}", stderr(&resumed));
    let value: Value = serde_json::from_slice(&resumed.stdout).unwrap();
    assert_eq!(value["proof"]["score"]["n"], 2);
    assert!(out.join("trials/plasmode-001.json").exists());
}

#[test]
fn a_folder_without_sealed_sessions_and_a_wrong_command_line_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("made/sessions/unsealed")).unwrap();
    for name in ["made", "missing"] {
        let made = folder.path().join(name);
        let arguments = ["--sessions", made.to_str().unwrap()];
        let refused = evrig(&arguments, &folder.path().join("a"));
        assert_eq!(refused.status.code(), Some(1));
        assert!(stderr(&refused).contains("seal.json"), "{}", stderr(&refused));
    }
    assert!(!folder.path().join("a").exists(), "no run was started");
    let both = evrig(&["--quick", "--single", "3"], &folder.path().join("b"));
    assert_eq!(both.status.code(), Some(2));
    let missing = evrig(&["--recording", "no/such.aedat4"], &folder.path().join("c"));
    assert_eq!(missing.status.code(), Some(1));
    assert!(stderr(&missing).contains("no/such.aedat4"), "{}", stderr(&missing));
    assert!(!folder.path().join("c/plan.json").exists(), "no run was started");
}
