//! A real rig: `EVRIG_HARDWARE=rig/lab.toml cargo test --test devices hardware:: -- --nocapture`.
//!
//! The arm drives the bundled trajectory `line`: 40 mm in the air before the target. Skipped when
//! the variable is unset. `EVRIG_HARDWARE=sim` runs the test on the simulated rig.

use evrig::rig::Rig;
use evrig::session::{Session, SessionStatus, StreamKind, verify};
use std::path::Path;
use std::process::{Command, Output};

const TRAJECTORY: &str = "line";
/// A DAVIS346 sends inertial samples at 1 kHz by default and at no less than this.
const MIN_IMU_HZ: f64 = 100.0;

fn evrig(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_evrig")).args(arguments).output().unwrap();
    eprintln!("{arguments:?}: {}", output.status);
    eprintln!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// Elements per second of a stream, between its first and its last.
fn rate_hz(session: &Session, kind: StreamKind, name: &str) -> f64 {
    let stream = session.stream(kind, name).unwrap_or_else(|error| panic!("{error}"));
    let [first, last] = [stream.first_us, stream.last_us].map(|time| time.expect("has elements"));
    (stream.count - 1) as f64 / ((last - first) as f64 * 1e-6)
}

#[test]
fn the_rig_is_ready_and_its_first_recording_assert_complete() {
    let Ok(name) = std::env::var("EVRIG_HARDWARE") else {
        eprintln!("skipped: set EVRIG_HARDWARE to the description of a connected rig");
        return;
    };
    let rig = Rig::find(&name).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    let checked = evrig(&["check", &name, TRAJECTORY, "--out", folder.path().to_str().unwrap()]);
    assert_eq!(checked.status.code(), Some(0), "see the findings of `evrig check`");
    let recorded =
        evrig(&["record", &name, TRAJECTORY, "--yes", "--quiet", "--out", out.to_str().unwrap()]);
    assert_eq!(recorded.status.code(), Some(0), "a recording without losses");
    assert_complete(&out, &rig);
}

fn assert_complete(out: &Path, rig: &Rig) {
    let session = Session::open(out).unwrap();
    assert_eq!(
        (session.manifest().status, &session.manifest().losses),
        (SessionStatus::Complete, &vec![])
    );
    assert!(verify(&session).unwrap().holds());
    for device in &session.manifest().recording.as_ref().unwrap().devices {
        assert_eq!(device.n_dropped, 0, "{}: {}", device.name, device.description);
    }
    let within = |rate: f64, wanted: f64| (rate / wanted - 1.0).abs() < 0.02;
    let raw = rate_hz(&session, StreamKind::Frames, "raw");
    assert!(within(raw, rig.pi.camera.frame_rate.0), "{raw} raw frames a second");
    let poses = rate_hz(&session, StreamKind::Poses, "arm");
    assert!(poses > 0.5 * rig.arm.pose_rate.0, "{poses} poses a second");
    let imu = rate_hz(&session, StreamKind::Imu, "imu");
    assert!(imu > MIN_IMU_HZ, "{imu} inertial samples a second");
    let events = session.stream(StreamKind::Events, "real").unwrap().count;
    assert!(events > 1_000, "{events} events: is there light, is a cap on the lens?");
}
