//! Recordings in the layout of the published recorder, with its known defects.

use crate::sessions::{evrig, run};
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, StreamSpec, Writer};
use evrig::format::npy::{Column, Npz};
use evrig::geometry::Size;
use evrig::session::Session;
use std::fs;
use std::path::Path;

fn davis(path: &Path) {
    let events: Events =
        (0..20).map(|i| Event { t: 1_748_797_446_000_000 + i, x: 1, y: 2, on: true }).collect();
    let specs = [StreamSpec::events(Size::DAVIS346, "DAVIS346_00000001")];
    let mut writer = Writer::create(path, Compression::Lz4, &specs).unwrap();
    writer.write_events(0, events.as_slice()).unwrap();
    writer.finish().unwrap();
}

fn record(sensor: f64, text: &str) -> Vec<u8> {
    let mut bytes = sensor.to_le_bytes().to_vec();
    bytes.extend_from_slice(text.as_bytes());
    bytes.resize(38, 0);
    bytes
}

fn raw_frame(k: u16, shift: u16) -> Vec<u8> {
    (0..48).flat_map(|i| ((64 + k * 48 + i) << shift).to_le_bytes()).collect()
}

/// Runs the import; exit code and both outputs.
fn import(directory: &Path, id: &str, session: &Path) -> (i32, String) {
    let arguments = ["import", "raw2event", "--size", "8x6", "--id", id, "--out"];
    run(evrig().args(arguments).arg(session).arg(directory))
}

fn array(path: &Path, name: &str) -> (Vec<u64>, Column) {
    let array = Npz::open(path).unwrap().array(name).unwrap();
    (array.shape, array.fields.into_iter().next().unwrap().1)
}

/// Writes a recording with every known defect of the layout; returns its RGB samples.
fn defective_recording(root: &Path) -> Vec<u8> {
    davis(&root.join("dv_output_3_cat_17_20250601_170404.aedat4"));
    // Another recording with the same tag, a minute later, must be kept apart.
    davis(&root.join("dv_output_3_cat_17_20250601_170504.aedat4"));
    fs::write(root.join("metadata_3_cat_17_20250601_170506.dat"), record(0.0, "x")).unwrap();

    let mut metadata = Vec::new();
    metadata.extend(record(0.0, "2025-06-01 17:04:06.000100"));
    metadata.extend(record(16_666.0, "2025-06-01 17:04:06.017000"));
    // A frame is missing here; the wall clock shows a whole second and then steps back.
    metadata.extend(record(49_998.0, "2025-06-01 17:04:07"));
    metadata.extend(record(66_664.0, "2025-06-01 17:04:06.067000"));
    metadata.extend(record(0.0, ""));
    metadata.extend([7; 5]);
    fs::write(root.join("metadata_3_cat_17_20250601_170406.dat"), metadata).unwrap();
    let mut raw: Vec<u8> = (0..5).flat_map(|k| raw_frame(k, 6)).collect();
    raw.extend([1; 10]);
    fs::write(root.join("raw_frames_3_cat_17_20250601_170406.dat"), raw).unwrap();
    let rgb: Vec<u8> = (0..4 * 192).map(|i| (i % 251) as u8).collect();
    fs::write(root.join("rgb_frames_3_cat_17_20250601_170406.dat"), &rgb).unwrap();
    rgb
}

#[test]
fn a_pi_5_recording_with_every_defect_is_imported_and_the_decisions_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let rgb = defective_recording(root);
    let session = root.join("session");
    let (code, printed) = import(root, "170404", &session);
    assert_eq!(code, 3, "{printed}");
    for expected in [
        "in us since the first frame",
        "left-justified (a Pi 5)",
        "known defect of the layout",
        "metadata_3_cat_17_20250601_170406.dat belongs to",
        "by tag, 2 s apart",
        "a last partial record of 5 bytes",
        "1 records at the end were never filled",
        "1 frames missing between others",
        "1 places where RealTime goes back",
        "a last partial frame of 10 bytes",
        "1 frames without a metadata record",
    ] {
        assert!(printed.contains(expected), "{expected}: {printed}");
    }
    let out = root.join("raw.npz");
    evrig()
        .arg("export")
        .arg(&session)
        .args(["--stream", "raw", "--out"])
        .arg(&out)
        .assert()
        .code(0);
    let (shape, frames) = array(&out, "frames");
    assert_eq!(shape, [4, 6, 8]);
    assert_eq!(frames, Column::Int((64..64 + 192).collect()));
    let (_, sensor) = array(&out, "sensor_timestamp_ns");
    assert_eq!(sensor, Column::Int(vec![0, 16_666_000, 49_998_000, 66_664_000]));
    let (_, real) = array(&out, "real_time_us");
    let Column::Int(real) = real else { panic!("whole microseconds") };
    assert_eq!(real[2], 1_748_797_447_000_000);
    evrig()
        .arg("export")
        .arg(&session)
        .args(["--stream", "rgb", "--out"])
        .arg(&out)
        .assert()
        .code(0);
    let (shape, frames) = array(&out, "frames");
    assert_eq!(shape, [4, 6, 8, 4]);
    assert_eq!(frames, Column::Int(rgb.iter().map(|v| i64::from(*v)).collect()));
    evrig().arg("verify").arg(&session).assert().code(3);
    evrig().arg("info").arg(&session).assert().code(0);
    assert_eq!(Session::open(&session).unwrap().events("real").unwrap().0.len(), 20);
}

#[test]
fn a_pi_4_recording_in_nanoseconds_is_imported_without_losses() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    davis(&root.join("dv_output_a_20250601_170404.aedat4"));
    let stamps = (0..4).map(|k| record(5e13 + f64::from(k) * 8_333_000.0, "2025-06-01 17:04:06.5"));
    fs::write(root.join("metadata_a_20250601_170406.dat"), stamps.flatten().collect::<Vec<u8>>())
        .unwrap();
    let raw: Vec<u8> = (0..4).flat_map(|k| raw_frame(k, 0)).collect();
    fs::write(root.join("raw_frames_a_20250601_170406.dat"), raw).unwrap();
    let session = root.join("session");
    let (code, printed) = import(root, "170406", &session);
    assert_eq!(code, 0, "{printed}");
    assert!(printed.contains("in ns since boot"), "{printed}");
    assert!(printed.contains("right-justified 10 bit (a Pi 4)"), "{printed}");
    assert!(printed.contains("there is no rgb_frames file"), "{printed}");
}

#[test]
fn inconsistent_files_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let session = root.join("session");
    let (code, printed) = import(root, "x", &session);
    assert_eq!(code, 1);
    assert!(printed.contains("no recording has `x` in its name"), "{printed}");
    davis(&root.join("dv_output_a_20250601_170404.aedat4"));
    davis(&root.join("dv_output_b_20250601_170404.aedat4"));
    let (_, printed) = import(root, "170404", &session);
    assert!(printed.contains("matches several names"), "{printed}");
    let (_, printed) = import(root, "_a_", &session);
    assert!(printed.contains("holds no metadata_*.dat with the tag `a`"), "{printed}");
    let stamps = (0..4).map(|k| record(f64::from(k) * 8_333.0, "2025-06-01 17:04:06.5"));
    fs::write(root.join("metadata_a_20250601_170406.dat"), stamps.flatten().collect::<Vec<u8>>())
        .unwrap();
    let odd: Vec<u8> = (0..4 * 48_u16).flat_map(|i| (4096 + i).to_le_bytes()).collect();
    fs::write(root.join("raw_frames_a_20250601_170406.dat"), odd).unwrap();
    let (code, printed) = import(root, "_a_", &session);
    assert_eq!(code, 1);
    assert!(
        printed.contains("frame 0 is no 10-bit raw frame; is --size 8 x 6 right?"),
        "{printed}"
    );
    assert!(!session.exists());
}
