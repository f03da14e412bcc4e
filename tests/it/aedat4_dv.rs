//! AEDAT4 to and from dv-processing, the library of the camera's manufacturer.
//!
//! Needs a Python with `dv-processing` and `numpy`, named by `EVRIG_PYTHON`; skipped when unset.

use crate::sessions::python;
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, Content, Reader, StreamSpec, Writer};
use evrig::frame::{Channels, Frame, FrameTiming, Samples};
use evrig::geometry::Size;
use evrig::imu::{ImuSample, Trigger, TriggerKind};
use evrig::time::{Davis, Span, Stamp};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

const CAMERA: &str = "DAVIS346_00000042";
const START_US: i64 = 1_700_000_000_000_000;

/// The contents of a recording.
#[derive(Debug, Default, PartialEq)]
struct RecordingContents {
    events: Events,
    frames: Vec<Frame<Davis>>,
    imu: Vec<ImuSample>,
    triggers: Vec<Trigger>,
}

fn truth() -> RecordingContents {
    // Two very different rates, so that packets are split by time and by number.
    let event = |i: i64| Event {
        t: START_US + if i < 60_000 { i / 20 } else { 3_000 + (i - 60_000) * 40 },
        x: (i * 7 % 346) as u16,
        y: (i * 13 % 260) as u16,
        on: i % 3 == 0,
    };
    let layouts =
        [(Channels::Gray, 8), (Channels::Bgr, 8), (Channels::Bgra, 8), (Channels::Gray, 16)];
    let frame = |(i, (channels, bits)): (usize, (Channels, usize))| {
        let size = Size::new(346, 260);
        let n = size.n_pixels() * channels.count();
        let start = Stamp::from_micros(START_US + 40_000 * i as i64);
        let sample = |k: usize| (k * 31 + i * 7) as u16;
        Frame {
            timing: FrameTiming {
                stamp: start,
                exposure: Some([start, start + Span::from_micros(4_321)]),
                readout: None,
                row_time: Span::ZERO,
            },
            size,
            origin: [0, 0],
            channels,
            samples: if bits == 8 {
                Samples::U8((0..n).map(|k| sample(k) as u8).collect())
            } else {
                Samples::U16((0..n).map(sample).collect())
            },
        }
    };
    let sample = |i: u8| ImuSample {
        stamp: Stamp::from_micros(START_US + 1_000 * i64::from(i)),
        temperature_c: 25.5,
        acceleration_g: [f32::from(i) * 0.25, -1.0, 0.0],
        rotation_deg_per_s: [0.5, f32::from(i), -3.25],
        magnetic_ut: [1.0, 2.0, 0.125],
    };
    let trigger = |i: i8| Trigger {
        stamp: Stamp::from_micros(START_US + 7_000 * i64::from(i)),
        kind: TriggerKind::from_code(i),
    };
    RecordingContents {
        events: (0..70_000).map(event).collect(),
        frames: layouts.into_iter().enumerate().map(frame).collect(),
        imu: (0..200).map(sample).collect(),
        triggers: (0..10).map(trigger).collect(),
    }
}

fn as_json(truth: &RecordingContents) -> Value {
    let frame = |frame: &Frame<Davis>| {
        let [start, end] = frame.timing.exposure.expect("the truth has exposures");
        let samples: Vec<u16> = match &frame.samples {
            Samples::U8(samples) => samples.iter().copied().map(u16::from).collect(),
            Samples::U16(samples) => samples.clone(),
        };
        json!({
            "t": frame.timing.stamp.as_micros(), "exposure_us": (end - start).as_micros(),
            "origin": frame.origin, "width": frame.size.width, "height": frame.size.height,
            "channels": frame.channels.count(), "bits": frame.samples.bits(), "samples": samples,
        })
    };
    let sample = |sample: &ImuSample| {
        let [ax, ay, az] = sample.acceleration_g;
        let [gx, gy, gz] = sample.rotation_deg_per_s;
        let [mx, my, mz] = sample.magnetic_ut;
        let t = sample.stamp.as_micros();
        json!([t, sample.temperature_c, ax, ay, az, gx, gy, gz, mx, my, mz])
    };
    let events = truth.events.as_slice().iter();
    let trigger = |trigger: &Trigger| json!([trigger.stamp.as_micros(), trigger.kind.code()]);
    json!({
        "camera": CAMERA, "width": 346, "height": 260,
        "events": events.map(|e| json!([e.t, e.x, e.y, u8::from(e.on)])).collect::<Vec<_>>(),
        "frames": truth.frames.iter().map(frame).collect::<Vec<_>>(),
        "imu": truth.imu.iter().map(sample).collect::<Vec<_>>(),
        "triggers": truth.triggers.iter().map(trigger).collect::<Vec<_>>(),
    })
}

fn write(truth: &RecordingContents, path: &Path, compression: Compression) {
    let size = Size::DAVIS346;
    let streams = [
        StreamSpec::events(size, CAMERA),
        StreamSpec::frames(size, CAMERA),
        StreamSpec::imu(CAMERA),
        StreamSpec::triggers(CAMERA),
    ];
    let mut writer = Writer::create(path, compression, &streams).unwrap();
    writer.write_events(0, truth.events.as_slice()).unwrap();
    for frame in &truth.frames {
        writer.write_frame(1, frame).unwrap();
    }
    writer.write_imu(2, &truth.imu).unwrap();
    writer.write_triggers(3, &truth.triggers).unwrap();
    writer.finish().unwrap();
}

fn read(path: &Path) -> RecordingContents {
    let mut recording = RecordingContents::default();
    for packet in Reader::open(path).unwrap() {
        match packet.unwrap().content {
            Content::Events(events) => recording.events.extend_from_slice(events.as_slice()),
            Content::Frame(frame) => recording.frames.push(frame),
            Content::Imu(samples) => recording.imu.extend(samples),
            Content::Triggers(triggers) => recording.triggers.extend(triggers),
            Content::Unknown { kind } => panic!("a packet of kind {kind}"),
        }
    }
    recording
}

fn run(python: &str, arguments: &[&std::ffi::OsStr]) {
    let script = "tests/python/aedat4_roundtrip.py";
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{script} {arguments:?}: {text}");
}

#[test]
fn dv_processing_and_evrig_read_each_others_files() {
    let Some(python) = python("dv-processing and numpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let truth = truth();
    let json = folder.path().join("truth.json");
    std::fs::write(&json, as_json(&truth).to_string()).unwrap();
    for (name, compression) in
        [("none", Compression::None), ("lz4", Compression::Lz4), ("zstd", Compression::Zstd)]
    {
        let by_evrig = folder.path().join(format!("evrig-{name}.aedat4"));
        write(&truth, &by_evrig, compression);
        run(&python, &["check".as_ref(), json.as_ref(), by_evrig.as_ref()]);
        let by_dv = folder.path().join(format!("dv-{name}.aedat4"));
        run(&python, &["write".as_ref(), json.as_ref(), by_dv.as_ref(), name.as_ref()]);
        assert!(read(&by_dv) == truth, "{name}: the file of dv-processing reads differently");
        assert!(read(&by_evrig) == truth, "{name}: the file of evrig reads differently");
    }
}
