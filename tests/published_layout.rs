//! A recording in the published layout, with what is known to go wrong in it, from import to scene.

#![allow(clippy::expect_used, clippy::unwrap_used)]

mod small_rig;

use evrig::frame::Samples;
use evrig::pipeline::{AnyTrack, TrackRequest, read_clocks, read_scene, read_track, track};
use evrig::session::{RecordedFrame, Session};
use evrig::time::PiSensor;
use serde_json::Value;
use std::fs;
use std::path::Path;

const FRAME_US: i64 = 8_333;

/// Frames in which something lies over the tag.
const COVERED: std::ops::Range<usize> = 45..65;

/// From this frame on the Pi's wall clock is half a minute ahead.
const SET_FORWARD: usize = 80;

/// The recording as the simulated rig made it.
struct Recording {
    session: Session,
    _directory: tempfile::TempDir,
}

fn recording() -> Recording {
    let directory = tempfile::tempdir().unwrap();
    let world = "[clocks]\npi_wall_offset_us = 4321.0\n";
    let session = small_rig::corner_session(world, &directory.path().join("session"));
    Recording { session, _directory: directory }
}

/// The tag's pixels in a frame of the Pi: columns and rows from and to, a margin about them.
fn tag_px(recording: &Recording, frame: &RecordedFrame<PiSensor>) -> [usize; 4] {
    let Some(AnyTrack::Pi(track)) = read_track(&recording.session, "raw").unwrap() else {
        panic!()
    };
    let view = track.at(frame.frame.timing.mid_exposure(120)).unwrap();
    let corners = track.plane.tag_corners_mm().map(|corner| view.pixel(corner));
    let end = |axis: usize, sign: f64| {
        let ends = corners.iter().map(|c| sign * c[axis]).fold(f64::NEG_INFINITY, f64::max);
        (sign * (ends + 12.0)).max(0.0) as usize
    };
    [end(0, -1.0), end(0, 1.0), end(1, -1.0), end(1, 1.0)]
}

/// The tag under bright paper: every pixel reads as much as the brightest of its colour.
fn cover(samples: &mut [u16], width: usize, [left, right, top, bottom]: [usize; 4]) {
    let height = samples.len() / width;
    let site = |i: usize| i / width % 2 * 2 + i % width % 2;
    let mut brightest = [0; 4];
    for (i, sample) in samples.iter().enumerate() {
        brightest[site(i)] = brightest[site(i)].max(*sample);
    }
    for row in top..bottom.min(height) {
        for column in left..right.min(width) {
            let i = row * width + column;
            samples[i] = brightest[site(i)];
        }
    }
}

fn metadata_record(picture: &RecordedFrame<PiSensor>, number: usize) -> Vec<u8> {
    let sensor = picture.frame.timing.stamp.as_nanos() as f64;
    let ahead_us = if number >= SET_FORWARD { 30_000_000 } else { 0 };
    let real_us = picture.properties.real_time.unwrap().as_micros() + ahead_us;
    let real = chrono::DateTime::from_timestamp_micros(real_us).unwrap();
    let mut bytes = sensor.to_le_bytes().to_vec();
    bytes.extend(real.format("%Y-%m-%d %H:%M:%S%.6f").to_string().as_bytes());
    bytes.resize(38, 0);
    bytes
}

/// Writes the recording as the published program would: the RGB frame of the next request beside each
/// raw one, one frame stamped as the one before it, the last frame without a record.
fn write_published(recording: &Recording, root: &Path) {
    let session = &recording.session;
    fs::copy(session.layout().davis(), root.join("dv_output_a_20231114_221320.aedat4")).unwrap();
    let pictures = |name| session.pi_frames(name).unwrap().map(Result::unwrap);
    let (mut raw, mut metadata) = (Vec::new(), Vec::new());
    let all: Vec<_> = pictures("raw").collect();
    for (number, picture) in all.iter().enumerate() {
        let Samples::U16(samples) = &picture.frame.samples else { panic!("raw frames") };
        let mut samples = samples.clone();
        if COVERED.contains(&number) {
            cover(&mut samples, 372, tag_px(recording, picture));
        }
        raw.extend(samples.iter().flat_map(|sample| sample.to_le_bytes()));
        // The recorder wrote frame 20's stamp once more with frame 21.
        let stamped = if number == 21 { &all[20] } else { picture };
        if number + 2 < all.len() {
            metadata.extend(metadata_record(stamped, number));
        }
    }
    let rgb = pictures("rgb").skip(1).flat_map(|picture| {
        let Samples::U8(samples) = picture.frame.samples else { panic!("8 bits") };
        samples.chunks_exact(3).flat_map(|p| [p[2], p[1], p[0], 0]).collect::<Vec<u8>>()
    });
    let to = |kind: &str| root.join(format!("{kind}_a_20231114_221322.dat"));
    fs::write(to("rgb_frames"), rgb.collect::<Vec<u8>>()).unwrap();
    fs::write(to("raw_frames"), raw).unwrap();
    fs::write(to("metadata"), metadata).unwrap();
}

/// Runs evrig; exit code, stdout and stderr.
fn evrig(args: &[&str]) -> (i32, String, String) {
    let output = assert_cmd::Command::cargo_bin("evrig").unwrap().args(args).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn a_published_recording_with_its_faults_comes_to_one_clock_and_one_target() {
    let recording = recording();
    let request = TrackRequest { stream: "raw".into(), rig: None, force: false };
    track(&recording.session, &request, &mut |_, _| {}).unwrap();
    let directory = tempfile::tempdir().unwrap();
    write_published(&recording, directory.path());
    let imported = directory.path().join("imported");
    let (root, session) = (directory.path().to_str().unwrap(), imported.to_str().unwrap());
    let size = ["--size", "372x240", "--id", "221320"];
    let (code, said, errors) =
        evrig(&[&["import", "raw2event", root, "--out", session], size.as_slice()].concat());
    assert_eq!(code, 3, "{said}{errors}");
    for expected in [
        "1 frames whose SensorTimestamp is not later than the one before",
        "1 places where RealTime goes back or jumps by more than 1 s",
        "frames without a metadata record were left out",
        "known defect of the layout",
    ] {
        assert!(format!("{said}{errors}").contains(expected), "{expected}: {said}{errors}");
    }
    let (code, said, errors) = evrig(&["track", session]);
    assert_eq!(code, 0, "{said}{errors}");
    assert!(said.contains("1 gaps of"), "the covered tag is a gap: {said}");
    let (code, said, errors) = evrig(&["sync", session, "--json"]);
    assert_eq!(code, 3, "{said}{errors}");
    let synced: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(synced["tally"]["n_duplicate"], 1);
    rgb_is_late_or_why_not_is_said(&imported);
    let (code, said, errors) = evrig(&["scene", session]);
    assert_eq!(code, 0, "{said}{errors}");
    the_scene_is_made(&imported);
    let (code, said, errors) = evrig(&["report", session]);
    assert_eq!(code, 0, "{said}{errors}");
    let html = fs::read_to_string(imported.join("report.html")).unwrap();
    for title in ["Interval convergence", "Radiance of the print", "Trajectory"] {
        assert!(html.contains(title), "{title}");
    }
}

/// In this second of motion the tracks may be too short to tell; a number must then not be claimed.
fn rgb_is_late_or_why_not_is_said(imported: &Path) {
    let clocks = read_clocks(&Session::open(imported).unwrap()).unwrap().unwrap();
    match (clocks.late[0].late_us, &clocks.late[0].refused) {
        (Some(late), None) => {
            let wrong = late.value - FRAME_US as f64;
            assert!(wrong.abs() < 4.0 * late.standard_error, "{late:?}");
        }
        (late, because) => assert!(late.is_none() && because.is_some(), "{late:?}"),
    }
}

fn the_scene_is_made(imported: &Path) {
    let scene = read_scene(&Session::open(imported).unwrap()).unwrap().unwrap();
    let [n, lost] = scene.survey.n_frames;
    // The frames in which the tag is covered are most of what may be lost.
    assert!(n - lost >= n - COVERED.len() - 3, "{n} frames, {lost} lost");
}
