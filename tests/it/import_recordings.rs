//! Recordings that other programs write are imported with everything that was planted.
//!
//! Needs a Python with `rosbags`, named by `EVRIG_PYTHON`; skipped when unset.

use crate::sessions::{python, run_json, text};
use evrig::event::Event;
use evrig::session::Session;
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
