//! The main workflow on a real recording: import, process, report.

use crate::sessions::evrig;
use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

const STREET: &str = "tests/data/davis346-street.aedat4";

fn json(command: &mut Command) -> Value {
    let output = command.arg("--json").output().expect("evrig runs");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| {
        panic!("stdout is not one JSON value: {error}: {}", String::from_utf8_lossy(&output.stderr))
    })
}

fn import(file: &Path, session: &Path) -> assert_cmd::assert::Assert {
    evrig().args(["import", "aedat4"]).arg(file).arg("--out").arg(session).assert()
}

fn count(info: &Value, stream: &str) -> Option<u64> {
    let streams = info["streams"].as_array().expect("streams are a list");
    streams.iter().find(|s| s["name"] == stream).and_then(|s| s["count"].as_u64())
}

#[test]
fn a_real_recording_is_processed_to_a_report() {
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("street");
    import(Path::new(STREET), &session).code(0);

    let info = json(evrig().arg("info").arg(&session));
    assert_eq!(count(&info, "real"), Some(78_830));
    assert_eq!(count(&info, "aps"), Some(59));
    assert_eq!(count(&info, "imu"), Some(2_363));

    let processed = json(evrig().arg("process").arg(&session));
    let stages = processed["stages"].as_array().unwrap();
    let stage = |name: &str| stages.iter().find(|stage| stage["stage"] == name).unwrap();
    let generated = stage("generate");
    assert!(generated["result"]["events"].as_u64().unwrap() > 1_000, "{processed}");

    let calibrated = stage("calibrate");
    for (i, k) in calibrated["result"]["passages"]["k"].as_array().unwrap().iter().enumerate() {
        assert!(k["value"].is_number() && k["ci95"][0].is_number(), "k{}: {k}", i + 1);
    }
    // `process` omits the search, which takes minutes.
    let fresh = json(evrig().args(["calibrate", "--evaluations", "0"]).arg(&session));
    assert_eq!(fresh["fresh"], true, "{fresh}");
    let tuned =
        json(evrig().args(["generate", "--k", "@calibrated", "--name", "own"]).arg(&session));
    assert_eq!(tuned["parameters"]["model"]["k"], fresh["k"], "{tuned}");
    // Events of constants that were kept are not generated twice.
    let is_tuned = calibrated["result"]["from"] != "published";
    assert_eq!(session.join("derived/generate-aps-tuned").exists(), is_tuned, "{processed}");

    let comparison = json(evrig().arg("compare").arg(&session));
    let measures = comparison["comparisons"][0]["measures"].as_array().unwrap();
    assert!(measures.len() >= 7, "{comparison}");
    for measure in measures {
        let (id, estimate) = (&measure["id"], &measure["estimate"]);
        assert!(estimate["value"].is_number(), "{id}: {measure}");
        assert!(estimate["standard_error"].is_number(), "{id}: {measure}");
    }

    evrig().arg("report").arg(&session).assert().code(0);
    let page = std::fs::read_to_string(session.join("report.html")).unwrap();
    assert!(page.contains("</html>"));
    evrig().arg("verify").arg(&session).assert().code(0);
}

#[test]
fn a_stage_with_unchanged_inputs_does_not_run_again() {
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("street");
    import(Path::new(STREET), &session).code(0);
    let first = json(evrig().arg("generate").arg(&session));
    assert_eq!(first["fresh"], false);
    let again = json(evrig().arg("generate").arg(&session));
    assert_eq!(again["fresh"], true);
    assert_eq!(again["events"], first["events"]);
    let other_seed = json(evrig().arg("generate").arg(&session).args(["--seed", "1"]));
    assert_eq!(other_seed["fresh"], false);
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads_and_any_folder() {
    let directory = tempfile::tempdir().unwrap();
    let mut results = Vec::new();
    for (name, threads) in [("one", "1"), ("two", "2")] {
        let session = directory.path().join(name);
        import(Path::new(STREET), &session).code(0);
        // The stages of `process` without the diagnosis, which takes minutes.
        let stages: [&[&str]; 4] = [
            &["calibrate", "--evaluations", "0"],
            &["generate", "--seed", "5"],
            &["generate", "--seed", "5", "--preset", "tuned", "--name", "aps-tuned"],
            &["compare"],
        ];
        for stage in stages {
            let run = evrig().args(stage).arg(&session).env("RAYON_NUM_THREADS", threads).assert();
            run.code(0);
        }
        let read = |file: &str| std::fs::read(session.join("derived").join(file)).unwrap();
        results.push([
            read("calibrate-aps/k.json"),
            read("generate-aps-tuned/events.aedat4"),
            read("generate-aps/events.aedat4"),
            read("generate-aps/stage.json"),
            read("compare-aps/comparison.json"),
            read("compare-aps/stage.json"),
        ]);
    }
    assert!(results[0] == results[1]);
}

#[test]
fn a_truncated_recording_is_imported_up_to_the_cut_with_a_loss() {
    let directory = tempfile::tempdir().unwrap();
    let bytes = std::fs::read(STREET).unwrap();
    let cut = directory.path().join("cut.aedat4");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let session = directory.path().join("session");
    let assert = import(&cut, &session).code(3);
    let printed = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(
        printed.contains("lost") && printed.contains("byte") && printed.contains("packet"),
        "{printed}"
    );
    let info = json(evrig().arg("info").arg(&session));
    let events = count(&info, "real").unwrap();
    assert!((10_000..78_830).contains(&events), "{events}");
    evrig().arg("verify").arg(&session).assert().code(3);
    evrig().arg("process").arg(&session).assert().code(3);
}

#[test]
fn a_file_that_is_not_a_recording_is_refused_and_leaves_no_session() {
    let directory = tempfile::tempdir().unwrap();
    let empty = directory.path().join("empty.aedat4");
    std::fs::write(&empty, "").unwrap();
    let text = directory.path().join("text.aedat4");
    std::fs::write(&text, "Dear diary, today I recorded nothing.\n").unwrap();
    for file in [&empty, &text, &directory.path().join("missing.aedat4")] {
        let session = directory.path().join("session");
        let assert = import(file, &session).code(1);
        let printed = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(printed.starts_with("error: ") && printed.lines().count() == 1, "{printed}");
        assert!(printed.contains(&*file.to_string_lossy()), "the error names the file: {printed}");
        assert!(!session.exists(), "no session is left");
    }
}

#[test]
fn a_session_is_never_overwritten() {
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("street");
    import(Path::new(STREET), &session).code(0);
    let assert = import(Path::new(STREET), &session).code(1);
    let printed = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(printed.contains("not empty"), "{printed}");
    evrig().arg("verify").arg(&session).assert().code(0);
}

#[test]
fn a_changed_file_does_not_verify() {
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("street");
    import(Path::new(STREET), &session).code(0);
    let path = session.join("davis.aedat4");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x40;
    std::fs::write(&path, bytes).unwrap();
    let assert = evrig().arg("verify").arg(&session).assert().code(4);
    let printed = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(printed.contains("FAIL  davis.aedat4"), "{printed}");
}

#[test]
fn wrong_usage_and_failure_have_different_exit_codes() {
    evrig().arg("info").assert().code(2);
    evrig().args(["info", "no/such/session"]).assert().code(1);
    evrig().args(["generate", "x", "--k", "1,2"]).assert().code(1);
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("street");
    import(Path::new(STREET), &session).code(0);
    let assert =
        evrig().arg("generate").arg(&session).args(["--preset", "dvs364"]).assert().code(2);
    let printed = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(printed.contains("did you mean `DVS346`"), "the nearest name is suggested: {printed}");
}
