//! `evrig camera-report` on the real recording and on tables of events.

use crate::sessions::evrig;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

const STREET: &str = "tests/data/davis346-street.aedat4";

fn report(path: &Path, options: &[&str]) -> Value {
    let output =
        evrig().arg("camera-report").arg(path).args(options).arg("--json").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn the_frames_of_a_davis_couple_into_on_events_with_the_readout_of_the_rows() {
    let found = report(Path::new(STREET), &[]);
    assert_eq!(found["schema"], "evrig.camera-report/1");
    assert_eq!(found["n_events"], 78_830);
    let coupling = &found["frame_coupling"];
    let bursts = coupling["bursts"].as_array().unwrap();
    let sweeping: Vec<&Value> =
        bursts.iter().filter(|burst| number(&burst["row_us"]["value"]).abs() > 1.0).collect();
    assert_eq!(sweeping.len(), 2, "two places of the frame's cycle");
    for burst in &sweeping {
        assert_eq!(burst["polarity"], "ON");
        assert!(number(&burst["z"]) > 100.0 && number(&burst["false_alarm_probability"]) < 1e-9);
        assert!((number(&burst["row_us"]["value"]) - 35.24).abs() < 0.05, "{}", burst["row_us"]);
        assert!(number(&burst["row_us"]["standard_error"]) < 0.05);
        for z in burst["halves_z"].as_array().unwrap() {
            assert!(number(z) > 50.0, "in either half of the time and of the pixels");
        }
        // After a burst the ON rate recovers over one to two milliseconds.
        let recovery_us = number(&burst["wake"]["recovery_us"]["value"]);
        assert!((800.0..2_000.0).contains(&recovery_us), "{recovery_us}");
    }
    let share: f64 = bursts.iter().map(|burst| number(&burst["share"]["value"])).sum();
    assert!((share - 0.1).abs() < 0.02, "about a tenth of the ON events: {share}");
    assert!(bursts.iter().all(|burst| burst["polarity"] == "ON"), "OFF events show none");
    for onset in found["refractory"].as_array().unwrap() {
        assert_eq!(onset["shape"], "soft", "{onset}");
        assert!(number(&onset["period_us"]["value"]) > 1_000.0);
    }
}

#[test]
fn a_table_without_frames_and_few_events_is_answered_with_reasons() {
    let directory = tempfile::tempdir().unwrap();
    let table = directory.path().join("few.csv");
    let mut text = String::from("t_us,x,y,p\n");
    for i in 0..300 {
        writeln!(text, "{},{},{},1", 1_000 * i + i % 7, i % 40, i % 30).unwrap();
    }
    std::fs::write(&table, text).unwrap();
    let out = directory.path().join("out");
    let found = report(&table, &["--size", "40x30", "--out", out.to_str().unwrap()]);
    for section in ["frame_coupling", "threshold_ratio", "readout"] {
        let reason = found[section]["not_measured"].as_str();
        assert!(reason.is_some_and(|reason| reason.len() > 20), "{section}: {}", found[section]);
    }
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("Camera report") && page.contains("Refractory period"));
}

#[test]
fn what_holds_no_events_is_refused_in_one_line() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("notes.md");
    std::fs::write(&file, "no events").unwrap();
    let output = evrig().arg("camera-report").arg(&file).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.starts_with("error: ") && error.trim_end().lines().count() == 1, "{error}");
    assert!(error.contains("notes.md") && error.contains("expected"), "{error}");
}
