//! A recording in the published layout with its known defects, from import to scene.

use crate::small_rig;

use evrig::frame::Samples;
use evrig::pipeline::{AnyTrack, TrackRequest, read_clocks, read_scene, read_track, track};
use evrig::session::{RecordedFrame, Session};
use evrig::time::PiSensor;
use serde_json::Value;
use std::fs;
use std::path::Path;

const FRAME_US: i64 = 8_333;

/// Frames in which the tag is covered.
const COVERED: std::ops::Range<usize> = 45..65;

/// First frame after a step of the Pi's wall clock by half a minute.
const CLOCK_STEP_FRAME: usize = 80;

/// The recording made by the simulated rig.
struct SimulatedRecording {
    session: Session,
    _directory: tempfile::TempDir,
}

fn recording() -> SimulatedRecording {
    let directory = tempfile::tempdir().unwrap();
    let world = "[clocks]\npi_wall_offset_us = 4321.0\n";
    let session = small_rig::corner_session(world, &directory.path().join("session"));
    SimulatedRecording { session, _directory: directory }
}

/// Column and row ranges of the tag in a frame of the Pi, with a margin.
fn tag_px(recording: &SimulatedRecording, frame: &RecordedFrame<PiSensor>) -> [usize; 4] {
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

/// Covers a region with bright paper: every pixel reads the maximum of its colour.
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

fn metadata_record(image: &RecordedFrame<PiSensor>, number: usize) -> Vec<u8> {
    let sensor = image.frame.timing.stamp.as_nanos() as f64;
    let ahead_us = if number >= CLOCK_STEP_FRAME { 30_000_000 } else { 0 };
    let real_us = image.properties.real_time.unwrap().as_micros() + ahead_us;
    let real = chrono::DateTime::from_timestamp_micros(real_us).unwrap();
    let mut bytes = sensor.to_le_bytes().to_vec();
    bytes.extend(real.format("%Y-%m-%d %H:%M:%S%.6f").to_string().as_bytes());
    bytes.resize(38, 0);
    bytes
}

/// Writes the recording as the published program does: RGB frames one request late, one repeated
/// timestamp, and no record for the last frames.
fn write_published(recording: &SimulatedRecording, root: &Path) {
    let session = &recording.session;
    fs::copy(session.layout().davis(), root.join("dv_output_a_20231114_221320.aedat4")).unwrap();
    let images = |name| session.pi_frames(name).unwrap().map(Result::unwrap);
    let (mut raw, mut metadata) = (Vec::new(), Vec::new());
    let all: Vec<_> = images("raw").collect();
    for (number, image) in all.iter().enumerate() {
        let Samples::U16(samples) = &image.frame.samples else { panic!("raw frames") };
        let mut samples = samples.clone();
        if COVERED.contains(&number) {
            cover(&mut samples, 372, tag_px(recording, image));
        }
        raw.extend(samples.iter().flat_map(|sample| sample.to_le_bytes()));
        // Frame 21 repeats the timestamp of frame 20.
        let stamped = if number == 21 { &all[20] } else { image };
        if number + 2 < all.len() {
            metadata.extend(metadata_record(stamped, number));
        }
    }
    let rgb = images("rgb").skip(1).flat_map(|image| {
        let Samples::U8(samples) = image.frame.samples else { panic!("8 bits") };
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
fn a_published_recording_with_defects_is_synchronized_and_registered() {
    let recording = recording();
    let request = TrackRequest { stream: "raw".into(), rig: None, force: false };
    track(&recording.session, &request, &mut |_, _| {}).unwrap();
    let directory = tempfile::tempdir().unwrap();
    write_published(&recording, directory.path());
    let imported = directory.path().join("imported");
    let (root, session) = (directory.path().to_str().unwrap(), imported.to_str().unwrap());
    let size = ["--size", "372x240", "--id", "221320"];
    let (code, printed, errors) =
        evrig(&[&["import", "raw2event", root, "--out", session], size.as_slice()].concat());
    assert_eq!(code, 3, "{printed}{errors}");
    for expected in [
        "1 frames whose SensorTimestamp is not later than the one before",
        "1 places where RealTime goes back or jumps by more than 1 s",
        "frames without a metadata record were left out",
        "known defect of the layout",
    ] {
        assert!(format!("{printed}{errors}").contains(expected), "{expected}: {printed}{errors}");
    }
    let (code, printed, errors) = evrig(&["track", session]);
    assert_eq!(code, 0, "{printed}{errors}");
    assert!(printed.contains("1 gaps of"), "the covered tag is a gap: {printed}");
    let (code, printed, errors) = evrig(&["sync", session, "--json"]);
    assert_eq!(code, 3, "{printed}{errors}");
    let synced: Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(synced["tally"]["n_duplicate"], 1);
    check_rgb_latency(&imported);
    let (code, printed, errors) = evrig(&["scene", session]);
    assert_eq!(code, 0, "{printed}{errors}");
    check_scene(&imported);
    let (code, printed, errors) = evrig(&["report", session]);
    assert_eq!(code, 0, "{printed}{errors}");
    let html = fs::read_to_string(imported.join("report.html")).unwrap();
    for title in ["Interval convergence", "Radiance of the target", "Trajectory"] {
        assert!(html.contains(title), "{title}");
    }
}

/// In one second of motion the tracks may be too short for an estimate; then none may be stated.
fn check_rgb_latency(imported: &Path) {
    let clocks = read_clocks(&Session::open(imported).unwrap()).unwrap().unwrap();
    match (clocks.stream_delays[0].delay_us, &clocks.stream_delays[0].refused) {
        (Some(late), None) => {
            let error_us = late.value - FRAME_US as f64;
            assert!(error_us.abs() < 4.0 * late.standard_error, "{late:?}");
        }
        (late, because) => assert!(late.is_none() && because.is_some(), "{late:?}"),
    }
}

fn check_scene(imported: &Path) {
    let scene = read_scene(&Session::open(imported).unwrap()).unwrap().unwrap();
    let [n, lost] = scene.reconstruction.n_frames;
    // Only frames with a covered tag, and a few others, may be lost.
    assert!(n - lost >= n - COVERED.len() - 3, "{n} frames, {lost} lost");
}
