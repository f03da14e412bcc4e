//! `evrig prove` on the real recording: what a run leaves, and how it goes on.

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

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Trials that are stopped before they answer: everything but the diagnosis itself.
const STOPPED: &[&str] = &["--recording", STREET, "--single", "2", "--deadline", "0.000001"];

#[test]
fn a_run_leaves_records_is_not_run_over_and_goes_on_with_its_own_plan() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("proof");
    let none = evrig(&[STOPPED, &["--resume"]].concat(), &out);
    assert_eq!(none.status.code(), Some(1));
    assert!(words(&none).contains("no run was begun there"), "{}", words(&none));

    let first = evrig(STOPPED, &out);
    assert!(first.status.success(), "{}", words(&first));
    let value: Value = serde_json::from_slice(&first.stdout).unwrap();
    assert_eq!(value["proof"]["score"]["n"], 2);
    assert_eq!(value["proof"]["score"]["unanswered"], 2, "no answer in time is no answer");
    for name in ["plan.json", "proof-plasmode.json", "proof-plasmode.md"] {
        assert!(out.join(name).exists(), "{name}");
    }
    for trial in ["plasmode-as-it-is", "plasmode-000", "plasmode-001"] {
        assert!(out.join("trials").join(trial).with_extension("json").exists(), "{trial}");
        assert!(!out.join("sessions").join(trial).exists(), "{trial}: judged and removed");
    }

    let again = evrig(STOPPED, &out);
    assert_eq!(again.status.code(), Some(1));
    assert!(words(&again).contains("--resume"), "{}", words(&again));
    let other = evrig(&[STOPPED, &["--resume", "--seed", "9"]].concat(), &out);
    assert_eq!(other.status.code(), Some(1));
    assert!(words(&other).contains("`seed` is 1 there and 9 here"), "{}", words(&other));

    // A trial without its record is all that a kill loses.
    std::fs::remove_file(out.join("trials/plasmode-001.json")).unwrap();
    let resumed = evrig(&[STOPPED, &["--resume"]].concat(), &out);
    assert!(resumed.status.success(), "{}", words(&resumed));
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
        let asked = ["--sessions", made.to_str().unwrap()];
        let refused = evrig(&asked, &folder.path().join("a"));
        assert_eq!(refused.status.code(), Some(1));
        assert!(words(&refused).contains("seal.json"), "{}", words(&refused));
    }
    assert!(!folder.path().join("a").exists(), "nothing is begun");
    let both = evrig(&["--quick", "--single", "3"], &folder.path().join("b"));
    assert_eq!(both.status.code(), Some(2));
    let missing = evrig(&["--recording", "no/such.aedat4"], &folder.path().join("c"));
    assert_eq!(missing.status.code(), Some(1));
    assert!(words(&missing).contains("no/such.aedat4"), "{}", words(&missing));
    assert!(!folder.path().join("c/plan.json").exists(), "nothing is begun");
}
