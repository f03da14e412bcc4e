//! What was written into a session comes back, on the right clock and row.

use super::*;
use crate::rig::Pose;
use crate::{
    ClockExchange, HostTime, Origin, Recording, RigLogWriter, SessionLayout, SessionStatus,
    TimedPose, Topic, seal_recording,
};
use evrig_core::frame::{BayerOrder, Channels, Samples};
use evrig_core::geometry::Size;
use evrig_core::pi_camera::{ClockSandwich, FrameMetadata, PiFrame};
use evrig_core::time::Span;
use std::path::Path;

const SIZE: Size = Size::new(8, 6);

fn host(ms: i64) -> HostTime {
    let unix = Stamp::from_micros(1_700_000_000_000_000 + ms * 1_000);
    HostTime { monotonic: Stamp::from_micros(ms * 1_000), unix }
}

fn metadata(k: u64) -> FrameMetadata {
    FrameMetadata {
        sequence: k,
        sensor_timestamp: Stamp::from_micros(50_000_000 + 8_333 * k as i64),
        frame_wall_clock: None,
        real_time: host(8 * k as i64).unix,
        exposure: Span::from_micros(4_000),
        analogue_gain: 2.0,
        digital_gain: 1.5,
        lens_position: None,
        black_levels: [64, 65, 66, 67],
        size: SIZE,
        bayer: "RGGB".into(),
        n_dropped: 0,
    }
}

fn sample(k: u64, i: usize) -> u16 {
    ((k * 131 + i as u64 * 17) % 1024) as u16
}

fn frame(k: u64) -> PiFrame {
    let samples: Vec<u16> = (0..SIZE.n_pixels()).map(|i| sample(k, i)).collect();
    let rgb = (0..SIZE.n_pixels()).flat_map(|i| [i as u8, k as u8, 200]).collect();
    let raw10 = evrig_core::raw10::pack(&samples, SIZE).unwrap();
    PiFrame { metadata: metadata(k), raw10: Some(raw10), rgb: Some(rgb) }
}

const N_FRAMES: u64 = 5;

fn write_log(path: &Path) {
    let mut log = RigLogWriter::create(path).unwrap();
    for k in 0..N_FRAMES {
        let at = host(8 * k as i64 + 5);
        log.frame(&frame(k), at).unwrap();
        log.pose(Topic::ArmPose, at, Pose::from_mm_deg([200.0, k as f64, -5.0, 90.0])).unwrap();
        let sandwich = ClockSandwich {
            boottime_before: Stamp::from_micros(1),
            realtime: at.unix,
            boottime_after: Stamp::from_micros(2),
        };
        log.clock(&ClockExchange { asked: at, pi: sandwich, pi_raw: None, answered: at }).unwrap();
    }
    log.finish().unwrap();
}

fn recorded(root: &Path) -> Session {
    let layout = SessionLayout::new(root);
    write_log(&layout.rig_log());
    seal(&layout);
    Session::open(root).unwrap()
}

fn seal(layout: &SessionLayout) {
    let recording = Recording {
        rig: Rig::simulated().unwrap().text,
        trajectory: String::new(),
        devices: Vec::new(),
        ended: "done".into(),
        trajectory_began_ns: None,
        clocks: serde_json::Value::Null,
    };
    let origin = Origin::Recorded { rig: "sim".into(), trajectory: "none".into() };
    seal_recording(layout, origin, SessionStatus::Complete, recording, Vec::new()).unwrap();
}

#[test]
fn a_raw_frame_comes_back_with_its_ten_bits_and_the_exposure_of_the_crops_first_row() {
    let dir = tempfile::tempdir().unwrap();
    let session = recorded(dir.path());
    assert!(session.is_from_pi("raw").unwrap());
    let images: Vec<_> = session.pi_frames("raw").unwrap().map(Result::unwrap).collect();
    assert_eq!(images.len(), N_FRAMES as usize);
    let RecordedFrame { number, frame, properties } = &images[3];
    assert_eq!(*number, 3);
    let expected: Vec<u16> = (0..SIZE.n_pixels()).map(|i| sample(3, i)).collect();
    assert_eq!(frame.samples, Samples::U16(expected));
    assert_eq!((properties.bits, properties.bayer), (10, Some(BayerOrder::Rggb)));
    assert_eq!((properties.black_dn, properties.gain), ([64.0, 65.0, 66.0, 67.0], Some(3.0)));
    // The rig states 9.21 us a row, and its crop of 692 x 520 comes from the middle of 1536 x 864.
    assert_eq!(frame.origin, [422, 172]);
    let [start, end] = frame.timing.exposure.unwrap();
    let stamp = metadata(3).sensor_timestamp;
    assert_eq!(end - stamp, Span::from_nanos(172 * 9_210));
    assert_eq!(end - start, Span::from_micros(4_000));
    assert_eq!(frame.timing.mid_exposure(2) - end, Span::from_nanos(2 * 9_210 - 2_000_000));
}

#[test]
fn an_rgb_frame_keeps_its_colours_apart() {
    let dir = tempfile::tempdir().unwrap();
    let session = recorded(dir.path());
    let image = session.pi_frames("rgb").unwrap().nth(2).unwrap().unwrap();
    assert_eq!(image.frame.channels, Channels::Bgr);
    let Samples::U8(samples) = &image.frame.samples else { panic!("8 bits") };
    assert_eq!(samples[3 * 7..][..3], [200, 2, 7]);
    assert_eq!(image.properties.bayer, None);
}

#[test]
fn poses_and_clock_readings_come_back() {
    let dir = tempfile::tempdir().unwrap();
    let notes = recorded(dir.path()).rig_log_contents().unwrap();
    assert_eq!(notes.exchanges.len(), N_FRAMES as usize);
    assert_eq!(notes.metadata[4], metadata(4));
    assert!(notes.commanded.is_empty());
    let TimedPose { at, pose } = notes.poses[2];
    assert_eq!(at, host(21).unix);
    for (found, planted) in pose.to_mm_deg().into_iter().zip([200.0, 2.0, -5.0, 90.0]) {
        assert!((found - planted).abs() < 1e-9, "{pose:?}");
    }
}

#[test]
fn a_log_that_was_cut_gives_the_frames_before_the_cut() {
    let dir = tempfile::tempdir().unwrap();
    let layout = SessionLayout::new(dir.path());
    write_log(&layout.rig_log());
    let bytes = std::fs::read(layout.rig_log()).unwrap();
    // Behind the third frame's metadata and in front of the fourth's.
    let third = bytes.windows(12).position(|w| w == b"\"sequence\":3").unwrap();
    std::fs::write(layout.rig_log(), &bytes[..third]).unwrap();
    seal(&layout);
    let session = Session::open(dir.path()).unwrap();
    let mut images = session.pi_frames("raw").unwrap();
    assert_eq!(images.by_ref().map(Result::unwrap).count(), 3);
    assert_eq!(images.n_without_metadata(), 1, "the fourth image has no metadata");
}

#[test]
fn a_stream_is_not_read_on_a_clock_that_is_not_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let session = recorded(dir.path());
    assert!(matches!(session.davis_frames("raw"), Err(SessionError::OtherClock { .. })));
    let error = session.pi_frames("aps").err().unwrap().to_string();
    assert!(error.contains("raw, rgb"), "{error}");
}
