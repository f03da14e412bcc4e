//! The Pi's camera through picamera2, with a stand-in for the library that has its known pitfalls.
//!
//! Needs a Python with `numpy`, named by `EVRIG_PYTHON`; skipped when unset.

use evrig::delivery::Focus;
use evrig::geometry::Size;
use evrig::pi::order::CaptureSettings;
use evrig::pi::picamera::Picamera;
use evrig::pi::source::{FrameSource, SourceError};
use evrig::pi_camera::PiFrame;
use evrig::raw10;
use evrig::time::Span;
use evrig::units::Hertz;
use std::path::PathBuf;

const SIZE: Size = Size::new(692, 520);
/// Origin of the crop in the sensor mode of 1536 x 864.
const OFFSET: [usize; 2] = [420, 172];

fn settings() -> CaptureSettings {
    CaptureSettings {
        size: SIZE,
        frame_rate: Hertz(120.0),
        exposure: Span::from_micros(4_000),
        gain: 2.0,
        raw: true,
        rgb: true,
    }
}

/// A camera over the stand-in, configured by variables; none without a Python.
fn camera(folder: &tempfile::TempDir, variables: &str) -> Option<Picamera> {
    if std::env::var_os("EVRIG_PYTHON").is_none() {
        println!("skipped: EVRIG_PYTHON names no Python with numpy");
        return None;
    }
    let standin = std::fs::canonicalize("tests/python/standin").unwrap();
    let path = folder.path().join("python");
    let text = format!("export PYTHONPATH='{}' {variables}\n", standin.display());
    std::fs::write(folder.path().join("variables"), text).unwrap();
    std::os::unix::fs::symlink(standin.join("python"), &path).unwrap();
    Some(Picamera::new(&path))
}

fn take(camera: &mut Picamera, n: usize) -> Result<Vec<PiFrame>, SourceError> {
    let mut frames = Vec::new();
    while frames.len() < n {
        frames.extend(camera.next()?);
    }
    Ok(frames)
}

/// Derives the frame number from the top left sample and compares all others with its pattern.
fn assert_pattern(frame: &PiFrame) -> u64 {
    let [x0, y0] = OFFSET;
    let rgb = frame.rgb.as_ref().unwrap();
    let packed = frame.raw10.as_ref().unwrap();
    let row = raw10::row_bytes(SIZE.width).unwrap();
    let samples = raw10::unpack(packed, SIZE, row).unwrap();
    let known = (x0 + 7 * y0) % 1024;
    let k13 = (usize::from(samples[0]) + 1024 - known) % 1024;
    // 13 times 709 is 1 modulo 1024.
    let k = k13 * 709 % 1024;
    let mut at = 0;
    for y in y0..y0 + usize::from(SIZE.height) {
        for x in x0..x0 + usize::from(SIZE.width) {
            assert_eq!(usize::from(samples[at]), (x + 7 * y + 13 * k) % 1024, "raw at {x}, {y}");
            let expected = [k % 256, x % 256, y % 256].map(|value| value as u8);
            assert_eq!(rgb[3 * at..3 * at + 3], expected, "rgb at {x}, {y}");
            at += 1;
        }
    }
    k as u64
}

#[test]
fn raw_and_rgb_of_one_request_show_the_same_crop_on_either_board_and_byte_order() {
    for variables in ["STANDIN_BOARD=pi5", "STANDIN_BOARD=pi4", "STANDIN_SWAP=1"] {
        let folder = tempfile::tempdir().unwrap();
        let Some(mut camera) = camera(&folder, variables) else { return };
        let held = camera.configure(&settings()).unwrap();
        // The sensor counts in rows of 9.21 us.
        assert!((held.exposure - Span::from_micros(4_000)).as_micros().abs() < 10, "{held:?}");
        assert_eq!(held.gain, 2.0);
        camera.start().unwrap();
        let frames = take(&mut camera, 4).unwrap();
        let mut last: Option<(u64, &PiFrame)> = None;
        for frame in &frames {
            let k = assert_pattern(frame);
            if let Some((before, frame_before)) = last {
                let steps = (k + 1024 - before) % 1024;
                let counted = frame.metadata.sequence - frame_before.metadata.sequence;
                assert_eq!(counted, steps, "the numbers count the sensor's frames");
            }
            last = Some((k, frame));
            assert_eq!(frame.metadata.black_levels, [64; 4]);
            assert_eq!(frame.metadata.bayer, "RGGB");
            assert_eq!(frame.metadata.lens_position, Some(4.4));
            let apart = frame.metadata.frame_wall_clock.unwrap() - frame.metadata.real_time;
            assert!(apart.as_secs_f64().abs() < 60.0, "wall clock in microseconds: {apart}");
        }
        camera.stop();
        assert_eq!(camera.check().unwrap(), "imx708 through picamera2 0.0-standin");
        let description = camera.camera_description();
        assert!(description["focus"].as_str().unwrap().contains("locked"), "{description}");
        // A second take of the same camera.
        camera.configure(&settings()).unwrap();
        camera.start().unwrap();
        assert_pattern(&take(&mut camera, 1).unwrap()[0]);
        camera.stop();
    }
}

#[test]
fn frames_that_the_library_skips_leave_gaps_in_the_sequence_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut camera) = camera(&folder, "STANDIN_SKIP=5") else { return };
    camera.configure(&settings()).unwrap();
    camera.start().unwrap();
    let frames = take(&mut camera, 12).unwrap();
    camera.stop();
    let numbers: Vec<u64> = frames.iter().map(|frame| frame.metadata.sequence).collect();
    let n_gaps = numbers.windows(2).filter(|pair| pair[1] - pair[0] > 1).count();
    assert!(n_gaps >= 2, "{numbers:?}");
}

#[test]
fn raw_only_and_rgb_only_deliver_one_kind_of_frame() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut camera) = camera(&folder, "") else { return };
    for (raw, rgb) in [(true, false), (false, true)] {
        camera.configure(&CaptureSettings { raw, rgb, ..settings() }).unwrap();
        camera.start().unwrap();
        let frame = take(&mut camera, 1).unwrap().remove(0);
        assert_eq!((frame.raw10.is_some(), frame.rgb.is_some()), (raw, rgb));
        camera.stop();
    }
}

#[test]
fn every_failure_states_a_remedy() {
    let table = [
        ("STANDIN_ABSENT=1", settings(), "cable"),
        ("STANDIN_BLIND=1", settings(), "dioptres"),
        ("", CaptureSettings { size: Size::new(694, 520), ..settings() }, "multiple of 4"),
        ("", CaptureSettings { frame_rate: Hertz(200.0), ..settings() }, "1536 x 864 at 120"),
        ("", CaptureSettings { raw: false, rgb: false, ..settings() }, "pi.rgb"),
    ];
    for (variables, settings, expected) in table {
        let folder = tempfile::tempdir().unwrap();
        let Some(mut camera) = camera(&folder, variables) else { return };
        let message = camera.configure(&settings).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let folder = tempfile::tempdir().unwrap();
    let mut absent = Picamera::new(&folder.path().join("no-python"));
    assert!(absent.configure(&settings()).unwrap_err().to_string().contains("--python"));
}

#[test]
fn a_fixed_focus_in_dioptres_needs_no_autofocus() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut camera) = camera(&folder, "STANDIN_BLIND=1") else { return };
    camera.set_focus(Focus::Dioptres(4.25)).unwrap();
    camera.configure(&settings()).unwrap();
    camera.start().unwrap();
    assert_eq!(take(&mut camera, 1).unwrap()[0].metadata.lens_position, Some(4.25));
}

#[test]
fn a_library_that_crashes_in_a_take_is_reported_with_its_last_output() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut camera) = camera(&folder, "STANDIN_DIE=400") else { return };
    camera.configure(&settings()).unwrap();
    camera.start().unwrap();
    let message = take(&mut camera, 100_000).unwrap_err().to_string();
    assert!(message.contains("ends as configured"), "{message}");
}

#[test]
fn a_python_without_the_library_is_reported_with_the_install_command() {
    let Some(python) = std::env::var_os("EVRIG_PYTHON") else {
        println!("skipped: EVRIG_PYTHON names no Python");
        return;
    };
    let mut camera = Picamera::new(&PathBuf::from(python));
    let message = camera.check().unwrap_err().to_string();
    assert!(message.contains("apt install python3-picamera2"), "{message}");
}
