//! The command `evrig plan`: exit codes, output and error positions.

use assert_cmd::Command;
use std::process::Output;

fn evrig(args: &[&str]) -> Output {
    Command::cargo_bin("evrig").unwrap().args(args).output().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Writes a changed copy of the bundled circle and returns its path.
fn changed_circle(directory: &tempfile::TempDir, from: &str, to: &str) -> String {
    let text = std::fs::read_to_string("trajectories/circle.toml").unwrap();
    assert!(text.contains(from));
    let path = directory.path().join("mine.toml");
    std::fs::write(&path, text.replace(from, to)).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn a_bundled_trajectory_needs_no_files() {
    let elsewhere = tempfile::tempdir().unwrap();
    let output = Command::cargo_bin("evrig")
        .unwrap()
        .current_dir(elsewhere.path())
        .args(["plan", "circle", "--plot", "circle.svg"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stdout(&output).contains("the arm can run it"));
    let svg = std::fs::read_to_string(elsewhere.path().join("circle.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    for title in ["speed of the tool", "joint angles", "as the DAVIS sees it"] {
        assert!(svg.contains(title), "the plot has no `{title}`");
    }
}

#[test]
fn json_is_the_whole_plan_and_nothing_else() {
    let output = evrig(&["plan", "circle", "--json"]);
    let plan: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(plan["is_feasible"], true);
    let closed_form = std::f64::consts::TAU * 12.0 / 50.0 + 1.0;
    let duration = plan["segments"][1]["duration_s"].as_f64().unwrap();
    assert!((duration - closed_form).abs() < 1e-8, "{duration}");
    assert_eq!(plan["profile"][0]["x_mm"], 240.0);
}

#[test]
fn out_of_reach_exits_4_and_names_the_point() {
    let directory = tempfile::tempdir().unwrap();
    let mine = changed_circle(&directory, "x_mm = 240.0", "x_mm = 300.0");
    let output = evrig(&["plan", &mine]);
    assert_eq!(output.status.code(), Some(4));
    let printed = stdout(&output);
    assert!(printed.contains("beyond a limit: segment `circle` at "), "{printed}");
    assert!(printed.contains("the arm cannot run it"), "{printed}");
}

#[test]
fn an_invalid_file_exits_2_and_names_the_line() {
    let directory = tempfile::tempdir().unwrap();
    let mine = changed_circle(&directory, "radius_mm", "radus_mm");
    let output = evrig(&["plan", &mine]);
    assert_eq!(output.status.code(), Some(2));
    let printed = stderr(&output);
    let expected = "mine.toml:23: `radius_mm` is missing in [segment 2] (it has `radus_mm`)";
    assert!(printed.contains(expected), "{printed}");
    assert_eq!(printed.matches("error").count(), 1, "{printed}");
    assert!(output.stdout.is_empty());
}

#[test]
fn an_unknown_name_exits_2_with_a_suggestion() {
    for args in [["plan", "cirle", "--rig", "sim"], ["plan", "circle", "--rig", "magicien"]] {
        let output = evrig(&args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(stderr(&output).contains("did you mean `"), "{}", stderr(&output));
    }
}

#[test]
fn a_plot_that_cannot_be_written_is_an_error_with_its_path() {
    let output = evrig(&["plan", "circle", "--plot", "no/such/folder/a.svg"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("no/such/folder/a.svg"), "{}", stderr(&output));
}
