//! The command `evrig check`: exit codes and findings.

use serde_json::Value;

/// Exit code and the printed findings.
fn check(args: &[&str]) -> (i32, Value) {
    let output = assert_cmd::Command::cargo_bin("evrig")
        .unwrap()
        .arg("check")
        .args(args)
        .arg("--json")
        .output()
        .unwrap();
    let warnings = String::from_utf8_lossy(&output.stderr);
    assert!(!warnings.contains("suspended"), "an orderly end is not a stall: {warnings}");
    let value = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| {
        panic!("{error}: {}", String::from_utf8_lossy(&output.stderr));
    });
    (output.status.code().unwrap(), value)
}

fn verdict<'a>(value: &'a Value, what: &str) -> &'a str {
    let findings = value["findings"].as_array().unwrap();
    let finding = findings.iter().find(|finding| finding["subject"] == what);
    finding.unwrap_or_else(|| panic!("{what} was not checked: {value}"))["verdict"]
        .as_str()
        .unwrap()
}

#[test]
fn the_machine_is_checked_without_a_rig() {
    let (_, value) = check(&[]);
    for what in ["port", "disk", "clock"] {
        assert!(["good", "doubt", "bad"].contains(&verdict(&value, what)), "{value}");
    }
}

#[test]
fn the_simulated_rig_answers_and_can_run_the_circle() {
    let (_, value) = check(&["sim", "circle"]);
    for what in ["rig", "port", "identity", "alarms", "homed", "path"] {
        assert_eq!(verdict(&value, what), "good", "{value}");
    }
}

#[test]
fn an_absent_arm_is_reported_and_the_rig_is_not_ready() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("lab.toml");
    let rig = std::fs::read_to_string("rig/sim.toml").unwrap();
    let rig = rig.replacen("\nport = \"sim\"", "\nport = \"/dev/no-such-arm\"", 1);
    std::fs::write(&file, rig).unwrap();
    let (code, value) = check(&[file.to_str().unwrap(), "circle"]);
    assert_eq!(code, 4, "{value}");
    assert_eq!(value["ready"], false);
    assert_eq!(verdict(&value, "port"), "bad", "{value}");
    assert!(value.to_string().contains("/dev/no-such-arm"), "{value}");
    assert_eq!(verdict(&value, "path"), "good", "the path is checked nevertheless: {value}");
}

#[test]
fn an_output_folder_without_free_space_is_not_ready() {
    let (code, value) = check(&["sim", "circle", "--out", "/proc"]);
    assert_eq!(code, 4, "{value}");
    assert_eq!(verdict(&value, "disk"), "bad", "{value}");
}
