//! Recordings that other programs write are imported with everything that was planted, and what is
//! exported is read back by evrig and by other programs.
//!
//! Tests of other programs need a Python with their packages, named by `EVRIG_PYTHON`; they are skipped
//! when it is unset.

use crate::sessions::{python, run_json, text};
use evrig::event::{Event, Events};
use evrig::session::Session;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Second of the first event, µs.
const BASE_US: i64 = 1_000_000_000;

#[test]
fn recordings_of_ros_give_the_events_frames_and_samples_that_rosbags_wrote() {
    let Some(python) = python("rosbags") else { return };
    let directory = tempfile::tempdir().unwrap();
    for (kind, name) in [("ros1", "a.bag"), ("mcap", "two")] {
        let file = directory.path().join(name);
        let script = "tests/python/write_rosbags.py";
        let status = Command::new(&python).arg(script).arg(kind).arg(&file).status().unwrap();
        assert!(status.success(), "{script} failed");
        let session = directory.path().join(format!("session-{kind}"));
        let topic = ["--topic", "/dvs/events"];
        let arguments = ["import", text(&file), "--out", text(&session)];
        let (code, stderr, manifest) = run_json(&[&arguments[..], &topic].concat());
        assert_eq!(code, 0, "{stderr}");
        let decisions = manifest["decisions"].to_string();
        assert!(decisions.contains("/tf"), "{decisions}");
        let session = Session::open(&session).unwrap();
        let (found, _) = session.events("real").unwrap();
        let expected = (0..2_000_i64).map(|i| Event {
            t: BASE_US + 37 * i,
            x: (7 * i % 240) as u16,
            y: (3 * i % 180) as u16,
            on: i % 3 == 0,
        });
        assert!(found.as_slice().iter().eq(expected), "{kind}");
        let frames = session.davis_frames("aps").unwrap();
        let stamps: Vec<(i64, f32)> = frames
            .map(|frame| frame.unwrap().frame.luminance())
            .map(|luminance| (luminance.t_us - BASE_US, luminance.values[240 * 180 - 1]))
            .collect();
        assert_eq!(stamps, [(0, 0.0), (20_000, 1.0), (40_000, 2.0), (60_000, 3.0)]);
        let imu = session.manifest().streams.iter().find(|stream| stream.name == "imu").unwrap();
        assert_eq!((imu.count, imu.last_us), (8, Some(BASE_US + 70_000)));
    }
}

/// A session of 3000 events of the 346 x 260 sensor, with a pause of an hour.
fn recorded(directory: &Path) -> (PathBuf, Events) {
    let event = |i: i64| Event {
        t: 20_000 + 131 * i + i / 1_500 * 3_600_000_000,
        x: (i * 7 % 346) as u16,
        y: (i * 11 % 260) as u16,
        on: i % 3 == 0,
    };
    let events: Events = (0..3_000).map(event).collect();
    let file = directory.join("given.csv");
    let rows: Vec<String> = events
        .as_slice()
        .iter()
        .map(|e| format!("{},{},{},{}", e.t, e.x, e.y, u8::from(e.on)))
        .collect();
    std::fs::write(&file, format!("t_us,x,y,p\n{}\n", rows.join("\n"))).unwrap();
    let session = directory.join("session");
    let size = ["--size", "346x260"];
    let (code, stderr, _) =
        run_json(&[&["import", text(&file), "--out", text(&session)][..], &size].concat());
    assert_eq!(code, 0, "{stderr}");
    (session, events)
}

fn export(session: &Path, out: &Path, format: Option<&str>) {
    let mut arguments = vec!["export", text(session), "--stream", "real", "--out", text(out)];
    arguments.extend(format.iter().flat_map(|format| ["--format", format]));
    let (code, stderr, _) = run_json(&arguments);
    assert_eq!(code, 0, "{stderr}");
}

#[test]
fn every_export_of_events_is_imported_again_without_a_change() {
    let directory = tempfile::tempdir().unwrap();
    let (session, events) = recorded(directory.path());
    for (name, format) in [
        ("a.npz", None),
        ("a.h5", None),
        ("a.parquet", None),
        ("a.csv", None),
        ("a.txt", None),
        ("a.zip", None),
        ("a.aedat4", None),
        ("a.raw", None),
        ("v2e.h5", Some("v2e")),
        ("ros2.mcap", Some("ros2")),
    ] {
        let out = directory.path().join(name);
        export(&session, &out, format);
        let again = directory.path().join(format!("again-{name}"));
        let (code, stderr, _) = run_json(&["import", text(&out), "--out", text(&again)]);
        assert_eq!(code, 0, "{name}: {stderr}");
        let (found, _) = Session::open(&again).unwrap().events("real").unwrap();
        assert!(found == events, "{name}");
    }
}

#[test]
fn other_programs_read_the_exports_as_they_are() {
    let Some(python) = python("faery, h5py, mcap, numpy, pandas, pillow, rosbags") else { return };
    let directory = tempfile::tempdir().unwrap();
    let (session, _) = recorded(directory.path());
    for (name, format) in [
        ("events.npz", None),
        ("a.raw", None),
        ("a.zip", None),
        ("a.gif", None),
        ("v2e.h5", Some("v2e")),
        ("ros2.mcap", Some("ros2")),
    ] {
        export(&session, &directory.path().join(name), format);
    }
    let script = "tests/python/read_more_exports.py";
    let status = Command::new(&python).arg(script).arg(directory.path()).status().unwrap();
    assert!(status.success(), "{script} failed");
}

#[test]
fn an_ending_without_a_format_is_refused_with_those_that_have_one() {
    let directory = tempfile::tempdir().unwrap();
    let (session, _) = recorded(directory.path());
    let out = directory.path().join("a.foo");
    let export = ["export", text(&session), "--stream", "real", "--out", text(&out)];
    let (code, stderr, _) = run_json(&export);
    assert_eq!(code, 2);
    for ending in [".npz", ".raw", ".zip", ".gif", ".mp4"] {
        assert!(stderr.contains(ending), "{stderr}");
    }
    assert!(!out.exists());
}
