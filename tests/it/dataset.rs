//! A folder of sessions is processed to a dataset and a comparison table despite broken sessions.

use crate::devtools;

use crate::sessions::{copy, dataset, evrig, json, text, tree};
use serde_json::{Value, json};
use std::path::Path;

fn verdicts(value: &Value) -> Vec<(&str, &str)> {
    let sessions = value["sessions"].as_array().unwrap();
    sessions.iter().map(|s| (s["path"].as_str().unwrap(), s["verdict"].as_str().unwrap())).collect()
}

/// Every stage.json with its modification time: a stage that runs again rewrites its record.
fn records(root: &Path) -> Vec<(String, std::time::SystemTime)> {
    let is_record = |name: &String| name.ends_with("stage.json");
    let files = tree(root).into_iter().map(|(name, _)| name).filter(is_record);
    files
        .map(|name| {
            (name.clone(), std::fs::metadata(root.join(&name)).unwrap().modified().unwrap())
        })
        .collect()
}

#[test]
fn a_dataset_with_broken_sessions_is_processed_and_only_stale_stages_run_again() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 3);
    // One manifest is truncated, one is of a newer version, one session was never sealed.
    copy(&root.join("s0"), &root.join("cut"));
    std::fs::write(root.join("cut/session.json"), "{\"schema\": ").unwrap();
    copy(&root.join("s1"), &root.join("later"));
    let manifest = std::fs::read_to_string(root.join("later/session.json")).unwrap();
    let manifest = manifest.replace("evrig.session/2", "evrig.session/9");
    std::fs::write(root.join("later/session.json"), manifest).unwrap();
    std::fs::create_dir(root.join("unsealed")).unwrap();
    std::fs::write(root.join("unsealed/journal.jsonl"), "").unwrap();

    let (code, first, stderr) = json(evrig().arg("process").arg(&root));
    assert_eq!(code, 3, "{stderr}");
    assert_eq!(
        verdicts(&first),
        [
            ("cut", "failed"),
            ("later", "failed"),
            ("s0", "ok"),
            ("s1", "ok"),
            ("s2", "ok"),
            ("unsealed", "failed"),
        ]
    );
    let because = |i: usize| first["sessions"][i]["because"][0].as_str().unwrap();
    assert!(because(0).contains("not JSON"), "{}", because(0));
    assert!(
        because(1).contains("evrig.session/9") && because(1).contains("newer"),
        "{}",
        because(1)
    );
    assert!(because(5).contains("--repair"), "{}", because(5));
    for file in [
        "dataset.json",
        "CARD.md",
        "comparison.csv",
        "comparison.json",
        "comparison.html",
        "comparison-sessions.csv",
        "report.html",
        "s1/report.html",
    ] {
        assert!(root.join(file).is_file(), "{file}");
    }
    let card = std::fs::read_to_string(root.join("CARD.md")).unwrap();
    assert!(card.contains("6 sessions") && card.contains("| failed | 3 |"), "{card}");

    let before = records(&root);
    assert!(before.len() >= 6, "{before:?}");
    let (code, again, _) = json(evrig().arg("process").arg(&root));
    assert_eq!((code, &again), (3, &first), "the same dataset gives the same result");
    assert_eq!(records(&root), before, "nothing was stale");
    let (_, status, _) = json(evrig().args(["process", "--status"]).arg(&root));
    assert_eq!(status["sessions"][2]["verdict"], "ok", "{status}");
}

#[test]
fn the_comparison_of_a_dataset_is_the_mean_of_its_sessions() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 3);
    let list = directory.path().join("list.toml");
    std::fs::write(
        &list,
        "[[variant]]\nname = \"plain\"\nfrom = \"frames\"\npreset = \"DVS346\"\n\
        [[variant]]\nname = \"other\"\nfrom = \"frames\"\nmodel = \"esim\"\n",
    )
    .unwrap();
    let (code, value, stderr) =
        json(evrig().arg("compare").arg(&root).args(["--variants", text(&list)]));
    assert_eq!(code, 0, "{stderr}");
    let names: Vec<&str> =
        value["variants"].as_array().unwrap().iter().map(|v| v["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["other", "plain"]);
    let of_sessions: Vec<f64> = (0..3)
        .map(|i| {
            let session = root.join(format!("s{i}"));
            let (_, value, _) =
                json(evrig().arg("compare").arg(session).args(["--stream", "plain"]));
            value["comparisons"][0]["measures"][0]["estimate"]["value"].as_f64().unwrap()
        })
        .collect();
    let cell = &value["variants"][1]["cells"][0];
    assert_eq!(cell["measure"], "count_ratio");
    let mean = of_sessions.iter().sum::<f64>() / 3.0;
    assert!(
        (cell["mean"]["value"].as_f64().unwrap() - mean).abs() < 1e-12,
        "{cell} {of_sessions:?}"
    );
    assert_eq!(cell["mean"]["n"], 3);
    assert!(cell["mean"]["standard_error"].as_f64().unwrap() > 0.0, "{cell}");
    let csv = std::fs::read_to_string(root.join("comparison.csv")).unwrap();
    let row = csv.lines().find(|line| line.starts_with("plain,count_ratio,3,")).expect("a row");
    let written: f64 = row.split(',').nth(3).unwrap().parse().unwrap();
    assert!((written - mean).abs() < 1e-12, "{row}");
}

#[test]
fn sessions_of_two_rigs_are_reported_and_can_be_selected() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 2);
    let wide = directory.path().join("wide.npy");
    let mut writer = evrig::format::npy::ArrayWriter::<u8>::create(&wide, &[3, 8, 12]).unwrap();
    writer.extend(&[50; 3 * 8 * 12]).unwrap();
    writer.finish().unwrap();
    let other = directory.path().join("events.csv");
    std::fs::write(&other, "100,1,1,1\n200,2,1,0\n15000,3,3,1\n").unwrap();
    evrig()
        .args(["import", "frames", text(&wide), "--fps", "100", "--events", text(&other), "--out"])
        .arg(root.join("deeper/other"))
        .assert()
        .code(0);
    let (_, value, stderr) = json(evrig().arg("process").arg(&root));
    let warning = value["warnings"][0].as_str().unwrap();
    assert!(warning.contains("2 rigs") && warning.contains("24 x 10"), "{warning}");
    assert!(stderr.contains("2 rigs"), "{stderr}");
    assert_eq!(value["sessions"][0]["path"], "deeper/other");
    let (code, value, stderr) =
        json(evrig().arg("compare").arg(&root).args(["--rig", "imported frames, 24 x 10"]));
    assert_eq!(code, 0, "{stderr}");
    assert!(
        value["sessions"].as_array().unwrap().iter().all(|row| row["session"] != "deeper/other")
    );
    let (code, _, stderr) = json(evrig().arg("compare").arg(&root).args(["--rig", "nosuch"]));
    assert_eq!(code, 2);
    assert!(stderr.contains("24 x 10") && stderr.contains("12 x 8"), "{stderr}");
}

#[test]
fn a_concurrent_run_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 1);
    let lock = evrig::batch::lock_dataset(&root).unwrap();
    for verb in ["process", "compare"] {
        let (code, _, stderr) = json(evrig().arg(verb).arg(&root));
        assert_eq!(code, 1, "{stderr}");
        assert!(stderr.contains(&format!("process {}", std::process::id())), "{stderr}");
    }
    drop(lock);
    let session = evrig::session::Session::open(&root.join("s0")).unwrap();
    let lock = evrig::batch::lock_session(&session).unwrap();
    let (code, _, stderr) = json(evrig().arg("process").arg(root.join("s0")));
    assert_eq!(code, 1, "{stderr}");
    assert!(stderr.contains("is being processed by"), "{stderr}");
    let (code, value, _) = json(evrig().arg("process").arg(&root));
    assert_eq!(code, 3);
    assert!(value["sessions"][0]["because"][0].as_str().unwrap().contains("is being processed by"));
    drop(lock);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_ends_the_run_instead_of_failing_every_session() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 2);
    // Every write to this device fails with ENOSPC.
    std::os::unix::fs::symlink("/dev/full", root.join("s0/report.html")).unwrap();
    let (code, _, stderr) = json(evrig().arg("process").arg(&root));
    assert_eq!(code, 1, "{stderr}");
    let last = stderr.lines().last().unwrap();
    assert!(last.starts_with("error: s0: the run over the dataset was stopped"), "{last}");
    assert!(last.contains("report.html") && last.contains("No space left"), "{last}");
    assert!(!root.join("batch/outcomes/s1.json").exists(), "the run ended at the first error");
    // With free space the run continues with the remaining sessions.
    std::fs::remove_file(root.join("s0/report.html")).unwrap();
    let (code, value, stderr) = json(evrig().args(["process", "--only-failed"]).arg(&root));
    assert_eq!((code, &value["n_ok"]), (0, &serde_json::json!(2)), "{stderr}");
}

#[test]
fn invalid_options_for_a_dataset_give_a_one_line_error() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 1);
    let empty = directory.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    let session = root.join("s0");
    for (arguments, code, expected) in [
        (vec!["process", text(&empty)], 1, "no folder in it holds a session.json"),
        (vec!["process", text(&session), "--status"], 2, "is a session"),
        (vec!["process", text(&session), "--engine", "slurm"], 2, "is a session"),
        (vec!["process", text(&root), "--splits", "train=2"], 2, "no share"),
        (vec!["compare", text(&session), "--rig", "x"], 2, "belong to a dataset"),
    ] {
        let (found, _, stderr) = json(evrig().args(&arguments));
        assert_eq!(found, code, "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
        assert!(stderr.starts_with("error: ") && stderr.lines().count() == 1, "{stderr}");
    }
}

#[test]
fn the_dataset_page_fits_both_widths_and_sorts_and_prints() {
    let Some(program) = std::env::var("EVRIG_CHROMIUM").ok().filter(|p| !p.is_empty()) else {
        eprintln!("skipped: set EVRIG_CHROMIUM to a Chromium to render the page");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 2);
    copy(&root.join("s0"), &root.join("cut"));
    std::fs::write(root.join("cut/session.json"), "").unwrap();
    json(evrig().arg("process").arg(&root));
    let url = format!("file://{}", root.join("report.html").display());
    let mut browser = devtools::Browser::start(&program, &directory.path().join("profile"));
    for (width, media) in [(1280, "screen"), (390, "screen"), (794, "print")] {
        browser.call("Emulation.setEmulatedMedia", json!({ "media": media }));
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            json!({ "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600 }),
        );
        browser.call("Page.navigate", json!({ "url": url }));
        browser.wait_for("Page.loadEventFired");
        let wide = browser.evaluate("document.documentElement.scrollWidth - innerWidth");
        assert!(wide.as_f64().unwrap() <= 0.0, "{width} {media}: the page is too wide by {wide}");
        let loaded = browser.evaluate("performance.getEntriesByType('resource').filter(e => !e.name.startsWith('data:')).length");
        assert_eq!(loaded, 0, "the page loads no resources");
        if let Some(folder) = std::env::var_os("EVRIG_SCREENSHOTS") {
            use base64::Engine;
            let shot = browser.call(
                "Page.captureScreenshot",
                json!({ "format": "png", "captureBeyondViewport": true }),
            );
            let png =
                base64::engine::general_purpose::STANDARD.decode(shot["data"].as_str().unwrap());
            let name = format!("dataset-{width}-{media}.png");
            std::fs::write(std::path::PathBuf::from(folder).join(name), png.unwrap()).unwrap();
        }
    }
    let column = "[...document.querySelector('table.sortable').tBodies[0].rows].map(r => r.cells[0].textContent.trim()).join()";
    assert_eq!(browser.evaluate(column), "cut,s0,s1");
    browser.evaluate("(() => { const b = document.querySelector('table.sortable th button'); b.click(); b.click(); })()");
    assert_eq!(
        browser.evaluate(column),
        "s1,s0,cut",
        "pressing the heading twice reverses the order"
    );
    let link = browser.evaluate("document.querySelector('table.sortable a').getAttribute('href')");
    assert!(root.join(link.as_str().unwrap().trim_start_matches("./")).is_file(), "{link}");
}
