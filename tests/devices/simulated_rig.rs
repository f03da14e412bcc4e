//! The complete simulated rig: recorded by the engine in real time, and simulated in virtual time.

use crate::small_rig;

use evrig::drivers::{DriverError, OpenOptions, OpenRig};
use evrig::format::aedat4::{Content, Reader};
use evrig::imu::ImuSample;
use evrig::pi_camera::FrameMetadata;
use evrig::record::{
    Dwells, Prompts, RecordOutcome, RecordRequest, RecordState, StopToken, record,
};
use evrig::rig::Rig;
use evrig::session::{ClockExchange, Manifest, Session, SessionStatus, StreamKind, verify};
use evrig::sim::world::WorldDescription;
use evrig::trajectory::{OptionalSegments, Trajectory};
use serde_json::Value;
use small_rig::{small_rig, small_trajectory};
use std::path::Path;
use std::time::Duration;

/// Both cameras at one position over a small target, with few pixels.
fn rig() -> Rig {
    small_rig(&[
        ("[0.0, 18.0, -13.0]", "[0.0, 0.0, -13.0]"),
        ("[0.0, -18.0, -13.0]", "[0.0, 0.0, -13.0]"),
        ("size_px = [346, 260]", "size_px = [48, 32]"),
        ("size_px = [692, 520]", "size_px = [120, 80]"),
        ("focal_length_mm = 8.0", "focal_length_mm = 16.0"),
        ("tag_side_mm = 14.35", "tag_side_mm = 2.87"),
        ("picture_side_mm = 43.05", "picture_side_mm = 8.61"),
        ("gap_mm = 4.1\n", "gap_mm = 0.82\n"),
    ])
}

/// Rest, three millimetres to the right, dimmed rest.
fn trajectory() -> Trajectory {
    small_trajectory(&[
        ("dwell", "before", "duration_s = 0.3"),
        ("line", "there", "by_mm = [3.0, 0.0]"),
        ("dwell", "dimmed", "duration_s = 0.3\nset = { light_level = 0.5 }"),
    ])
}

fn opening<'a>(world: &'a WorldDescription, rig: &Rig) -> OpenOptions<'a> {
    let start = trajectory().path(rig, OptionalSegments::Included).unwrap().start();
    OpenOptions { replay_speed: None, home: false, start, world, seed: 3 }
}

fn record_to(out: &Path) -> (RecordOutcome, Vec<RecordState>) {
    let (rig, trajectory, world) = (rig(), trajectory(), WorldDescription::default());
    let path = trajectory.path(&rig, OptionalSegments::Included).unwrap();
    let mut bench = OpenRig::open(&rig, &opening(&world, &rig)).unwrap();
    let dwells = Dwells { lead_in: Duration::from_millis(100), tail: Duration::from_millis(100) };
    let request = RecordRequest {
        rig: &rig,
        trajectory: &trajectory,
        path: &path,
        out,
        dwells,
        prompts: Prompts::default(),
    };
    let mut states = Vec::new();
    let mut watch = |state, _| {
        if states.last() != Some(&state) {
            states.push(state);
        }
    };
    let stop = StopToken::default();
    let outcome = record(request, &mut bench.devices, &stop, &mut watch).unwrap();
    (outcome, states)
}

/// Messages of a topic of the rig's log, with their log times in microseconds.
fn messages(session: &Session, topic: &str) -> Vec<(i64, Value)> {
    let bytes = std::fs::read(session.layout().rig_log()).unwrap();
    let all = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let of_topic = all.filter(|message| message.channel.topic == topic);
    of_topic
        .map(|message| {
            let value = serde_json::from_slice(&message.data).unwrap();
            (i64::try_from(message.log_time / 1_000).unwrap(), value)
        })
        .collect()
}

/// Times when the arm was first 0.1 mm from its start, and when it had reached its end.
fn moved_between(session: &Session) -> [i64; 2] {
    let poses = messages(session, "/arm/pose");
    let position = |value: &Value| {
        ["x", "y", "z"].map(|axis| value["pose"]["position"][axis].as_f64().unwrap() * 1e3)
    };
    let away = |value: &Value, from: [f64; 3]| {
        position(value).iter().zip(from).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let (first, last) = (position(&poses[0].1), position(&poses[poses.len() - 1].1));
    let begun = poses.iter().find(|(_, pose)| away(pose, first) > 0.1).unwrap().0;
    let ended = poses.iter().find(|(_, pose)| away(pose, last) < 1e-3).unwrap().0;
    [begun, ended]
}

fn assert_verifies(session: &Session) {
    let verification = verify(session).unwrap();
    assert!(verification.holds(), "{:#?}", verification.findings);
}

#[test]
fn the_recorded_scene_moves_only_while_the_arm_moves() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    let (outcome, states) = record_to(&out);
    assert_eq!(outcome.cut_short, None, "{:?}", outcome.manifest.losses);
    assert_eq!(outcome.manifest.losses, []);
    assert!(
        states.ends_with(&[RecordState::Tail, RecordState::Drain, RecordState::Seal]),
        "{states:?}"
    );
    let session = Session::open(&out).unwrap();
    assert_verifies(&session);
    let [begun, ended] = moved_between(&session);
    let (events, _) = session.events("real").unwrap();
    let t = events.as_slice().t;
    // The poses come every 20 ms, and the arm needs 30 ms for its first tenth of a millimetre.
    let early = t.iter().filter(|t| **t < begun - 60_000).count();
    assert_eq!(early, 0, "events before the arm moves at {begun}: {:?}", t.first());
    let moving = t.iter().filter(|t| (begun..ended).contains(*t)).count();
    assert!(moving > 500, "{moving} events while the arm moves");
    // After the motion only dimming causes events: half the light is 3.6 thresholds.
    let dimmed = events.as_slice().between(ended, i64::MAX);
    let n_pixels = 48 * 32;
    assert!((3 * n_pixels..=4 * n_pixels).contains(&dimmed.len()), "{} events", dimmed.len());
    // The tool's last micrometre may still bring a pixel to its threshold.
    assert!(dimmed.count_on() < 20, "{} ON events in falling light", dimmed.count_on());
    assert_imu_measures_motion(&session, [begun, ended]);
}

/// The inertial samples: one per millisecond, gravity along the downward optical axis, and an
/// acceleration above the noise only while the arm moves.
fn assert_imu_measures_motion(session: &Session, [begun, ended]: [i64; 2]) {
    let mut samples = Vec::new();
    for packet in Reader::open(session.layout().davis()).unwrap() {
        if let Content::Imu(more) = packet.unwrap().content {
            samples.extend(more);
        }
    }
    let count = session.stream(StreamKind::Imu, "imu").unwrap().count;
    assert_eq!(count, samples.len() as u64);
    let us = |sample: &ImuSample| sample.stamp.as_micros();
    assert!(samples.windows(2).all(|pair| us(&pair[1]) - us(&pair[0]) == 1_000));
    let mean = |from: i64, to: i64, axis: usize| {
        let within = samples.iter().filter(|sample| (from..to).contains(&us(sample)));
        let values: Vec<f64> =
            within.map(|sample| f64::from(sample.acceleration_g[axis])).collect();
        assert!(values.len() > 40, "{} samples", values.len());
        values.iter().sum::<f64>() / values.len() as f64
    };
    let before = begun - 60_000;
    let down = mean(i64::MIN, before, 2);
    assert!((down + 1.0).abs() < 0.061, "{down} g along the view");
    // It accelerates at 0.4 m/s^2 for 50 ms (22 ms for the first 0.1 mm) and decelerates alike at
    // the end: 0.041 g in both directions.
    let along =
        |from: i64, to: i64| [0, 1].map(|axis| mean(from, to, axis) - mean(i64::MIN, before, axis));
    let [up_x, up_y] = along(begun - 40_000, begun + 40_000);
    let [down_x, down_y] = along(ended - 70_000, ended);
    assert!(up_x.hypot(up_y) > 0.012, "{up_x}, {up_y} g as it speeds up");
    assert!(up_x * down_x + up_y * down_y < 0.0, "as it slows down: {down_x}, {down_y} g");
    let [rest_x, rest_y] = along(ended + 60_000, i64::MAX);
    assert!(rest_x.hypot(rest_y) < 0.004, "{rest_x}, {rest_y} g at rest");
}

#[test]
fn timestamps_of_the_simulated_pi_agree_with_its_clock_readings() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    record_to(&out);
    let session = Session::open(&out).unwrap();
    let readings = messages(&session, "/pi/clock");
    assert!(readings.len() >= 10, "{}", readings.len());
    let reading: ClockExchange = serde_json::from_value(readings[0].1.clone()).unwrap();
    let offset_ns = reading.pi.realtime.as_nanos() - reading.pi.boottime_after.as_nanos();
    let frames = messages(&session, "/pi/metadata");
    assert_eq!(session.stream(StreamKind::Frames, "raw").unwrap().count, frames.len() as u64);
    assert_eq!(session.stream(StreamKind::Frames, "rgb").unwrap().count, frames.len() as u64);
    let mut last: Option<FrameMetadata> = None;
    for (_, frame) in frames {
        let frame: FrameMetadata = serde_json::from_value(frame).unwrap();
        // After the end of the first row: 424 rows of 9.21 us and at least 4 ms of the interface.
        let row_end_ns = frame.sensor_timestamp.as_nanos() + offset_ns;
        let latency_us = (frame.real_time.as_nanos() - row_end_ns) / 1_000;
        assert!((7_000..40_000).contains(&latency_us), "{latency_us} us");
        if let Some(last) = &last {
            assert_eq!(frame.sequence, last.sequence + 1);
            let period_us = (frame.sensor_timestamp - last.sensor_timestamp).as_micros();
            assert!((8_332..=8_334).contains(&period_us), "{period_us} us");
        }
        last = Some(frame);
    }
}

#[test]
fn a_simulated_camera_requires_a_simulated_arm() {
    let text = rig().text.replacen("\nport = \"sim\"", "\nport = \"/dev/ttyUSB0\"", 1);
    let rig = Rig::parse("mixed.toml", &text).unwrap();
    let world = WorldDescription::default();
    let error = OpenRig::open(&rig, &opening(&world, &rig)).err().unwrap();
    assert!(matches!(error, DriverError::NoSimulatedArm { key: "davis.transport" }), "{error}");
    assert!(error.to_string().contains("arm.port"), "{error}");
}

fn simulate_to(out: &Path, effects: &str, n_threads: usize) -> Manifest {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
    pool.install(|| small_rig::simulated(&rig(), &trajectory(), effects, out))
}

#[test]
fn virtual_time_gives_the_same_bytes_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let effects = "[effects]\nshot_noise = { rms_thresholds = 0.2, bandwidth_hz = 100.0 }\n";
    let [one, three] = [1, 3].map(|n| {
        let out = folder.path().join(n.to_string());
        let manifest = simulate_to(&out, effects, n);
        assert_eq!(manifest.status, SessionStatus::Complete);
        assert_verifies(&Session::open(&out).unwrap());
        manifest.files
    });
    assert_eq!(one, three);
}

#[test]
fn a_simulated_session_contains_rig_and_trajectory_but_no_world_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    let effects = "[davis]\nthreshold = 0.23456789\n[effects]\nrefractory_period = { refractory_us = 8765.4321 }\n";
    let manifest = simulate_to(&out, effects, 2);
    let recording = manifest.recording.as_ref().unwrap();
    assert_eq!(recording.rig, rig().text);
    assert_eq!(recording.trajectory, trajectory().text);
    for file in ["session.json", "journal.jsonl", "rig.mcap", "davis.aedat4"] {
        let bytes = std::fs::read(out.join(file)).unwrap();
        for hidden in ["refractory", "8765.4321", "0.23456789"] {
            let found = bytes.windows(hidden.len()).any(|window| window == hidden.as_bytes());
            assert!(!found, "{file} contains {hidden}");
        }
    }
    let [begun, _] = moved_between(&Session::open(&out).unwrap());
    let began_us = recording.trajectory_began_ns.unwrap() / 1_000;
    assert!((begun - began_us - 300_000).abs() < 60_000, "{}", begun - began_us);
}
