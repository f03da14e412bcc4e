//! Readable recordings with inconsistent contents: every inconsistency is counted and reported.

use assert_cmd::Command;
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, StreamSpec, Writer};
use evrig::frame::{Frame, FrameTiming, Samples};
use evrig::geometry::Size;
use evrig::session::Session;
use evrig::time::{Davis, Stamp};
use std::path::{Path, PathBuf};

const SIZE: Size = Size::new(8, 6);

fn events(list: &[(i64, u16, u16)]) -> Events {
    list.iter().map(|&(t, x, y)| Event { t, x, y, on: t % 2 == 0 }).collect()
}

fn frame(t_us: i64, value: u8) -> Frame<Davis> {
    Frame::gray(
        FrameTiming::from_stamp(Stamp::from_micros(t_us)),
        SIZE,
        Samples::U8(vec![value; SIZE.n_pixels()]),
    )
}

fn record(directory: &Path, found: &Events, frames: &[Frame<Davis>]) -> PathBuf {
    let path = directory.join("recording.aedat4");
    let specs = [StreamSpec::events(SIZE, "test"), StreamSpec::frames(SIZE, "test")];
    let mut writer = Writer::create(&path, Compression::Zstd, &specs).unwrap();
    writer.write_events(0, found.as_slice()).unwrap();
    frames.iter().for_each(|frame| writer.write_frame(1, frame).unwrap());
    writer.finish().unwrap();
    path
}

/// Runs evrig; the exit code, stdout and stderr.
fn evrig(args: &[&str]) -> (i32, String, String) {
    let output = Command::cargo_bin("evrig").unwrap().args(args).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn import(directory: &Path, recording: &Path) -> (PathBuf, i32, String) {
    let session = directory.join("session");
    let paths = (recording.to_str().unwrap(), session.to_str().unwrap());
    let (code, printed, _) = evrig(&["import", "aedat4", paths.0, "--out", paths.1]);
    (session, code, printed)
}

#[test]
fn events_outside_the_sensor_are_excluded_and_unordered_ones_are_sorted_and_counted() {
    let directory = tempfile::tempdir().unwrap();
    let found = events(&[(10, 1, 1), (20, 8, 0), (25, 3, 3), (15, 2, 2), (30, 0, 6), (40, 7, 5)]);
    let recording = record(directory.path(), &found, &[frame(0, 9), frame(50, 9)]);
    let (session, code, printed) = import(directory.path(), &recording);
    assert_eq!(code, 3, "{printed}");
    assert!(printed.contains("2 events off the sensor"), "{printed}");
    assert!(printed.contains("1 events earlier than the one before"), "{printed}");
    let (events, tally) = Session::open(&session).unwrap().events("real").unwrap();
    assert_eq!(events.as_slice().t, [10, 15, 25, 40]);
    assert_eq!((tally.seen, tally.kept, tally.outside, tally.sorted_in), (6, 4, 2, 1));
}

#[test]
fn a_recording_without_frames_is_processed_without_generation() {
    let directory = tempfile::tempdir().unwrap();
    let recording = record(directory.path(), &events(&[(10, 1, 1), (20, 2, 2)]), &[]);
    let (session, code, printed) = import(directory.path(), &recording);
    assert_eq!(code, 0, "{printed}");
    let session = session.to_str().unwrap();
    let (code, printed, _) = evrig(&["process", session]);
    assert_eq!(code, 0, "{printed}");
    assert!(printed.contains("left out: the session has no frames"), "{printed}");
    let (code, _, printed) = evrig(&["generate", session]);
    assert_eq!(code, 1);
    assert!(printed.contains("has no frames to generate events from"), "{printed}");
    let (code, _, printed) = evrig(&["compare", session]);
    assert_eq!(code, 1);
    assert!(printed.contains("no simulated stream"), "{printed}");
    let (code, printed, _) = evrig(&["report", session]);
    assert_eq!(code, 0, "the report shows the existing results: {printed}");
}

#[test]
fn frames_without_increasing_timestamps_are_skipped_and_counted() {
    let directory = tempfile::tempdir().unwrap();
    let frames = [frame(0, 10), frame(1_000, 200), frame(1_000, 10), frame(2_000, 10)];
    let recording = record(directory.path(), &events(&[(10, 1, 1), (1_500, 2, 2)]), &frames);
    let (session, code, printed) = import(directory.path(), &recording);
    assert_eq!(code, 0, "{printed}");
    let (code, printed, _) = evrig(&["generate", session.to_str().unwrap()]);
    assert_eq!(code, 3, "{printed}");
    assert!(printed.contains("1 frames left out (not later)"), "{printed}");
}

#[test]
fn a_recording_given_as_a_session_is_refused_with_the_import_command() {
    let directory = tempfile::tempdir().unwrap();
    let recording = record(directory.path(), &events(&[(10, 1, 1)]), &[frame(0, 9)]);
    for command in ["info", "verify", "diagnose"] {
        let (code, printed, error) = evrig(&[command, recording.to_str().unwrap()]);
        assert_eq!(code, 1, "{command}: {printed}{error}");
        assert!(error.contains("recording.aedat4"), "{command}: {error}");
        assert!(error.contains("evrig import aedat4"), "{command}: {error}");
    }
}

#[test]
fn generating_the_diagnosed_camera_without_a_diagnosis_names_the_missing_command() {
    let directory = tempfile::tempdir().unwrap();
    let frames = [frame(0, 10), frame(1_000, 10)];
    let recording = record(directory.path(), &events(&[(10, 1, 1)]), &frames);
    let (session, code, printed) = import(directory.path(), &recording);
    assert_eq!(code, 0, "{printed}");
    let session = session.to_str().unwrap();
    let (code, _, error) = evrig(&["generate", session, "--diagnosed"]);
    assert_eq!(code, 1, "{error}");
    assert!(error.contains(&format!("evrig diagnose {session}")), "{error}");
    let (code, _, error) = evrig(&["generate", session, "--diagnosed", "nowhere.json"]);
    assert_eq!(code, 1, "{error}");
    assert!(error.contains("nowhere.json: no such file"), "{error}");
    let (code, _, error) = evrig(&["generate", session, "--diagnosed", "--from", "aps"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("leave --from out"), "{error}");
}

#[test]
fn comparing_streams_without_events_gives_unknown_measures() {
    let directory = tempfile::tempdir().unwrap();
    // Static frames without leak and noise: no event is generated.
    let recording = record(directory.path(), &events(&[]), &[frame(0, 10), frame(1_000, 10)]);
    let (session, code, printed) = import(directory.path(), &recording);
    assert_eq!(code, 0, "{printed}");
    let (code, printed, errors) =
        evrig(&["process", session.to_str().unwrap(), "--k", "5,20,0,0,0,0", "--json"]);
    assert_eq!(code, 0, "{printed}{errors}");
    let value: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let measures = value["stages"][1]["result"]["measures"].as_array().unwrap();
    for measure in measures {
        assert!(measure["estimate"]["value"].is_null(), "{measure}");
        assert!(measure["unknown_because"].is_string(), "{measure}");
    }
    let (code, printed, _) = evrig(&["report", session.to_str().unwrap()]);
    assert_eq!(code, 0, "{printed}");
}
