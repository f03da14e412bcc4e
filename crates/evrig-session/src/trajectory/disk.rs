//! Estimated data volume of a recording, by stream, with the basis of each estimate.

use super::ToolPath;
use crate::rig::{CameraDescription, Rig};
use evrig_format::aedat4::EVENT_BYTES;
use serde::Serialize;

/// Events per second of a plan while the arm moves. A budget, not a prediction: the
/// rate depends on texture, light and biases; the sensor itself saturates near 12 million.
const MOVING_EVENTS_PER_S: f64 = 2e6;
/// Events per second of a plan while the arm rests: leak, noise, flicker.
const RESTING_EVENTS_PER_S: f64 = 1e5;
/// Samples of the DAVIS's inertial unit: about 1 kHz, about 60 bytes each in AEDAT4.
const IMU_BYTES_PER_S: f64 = 60_000.0;
/// A pose with its times and record head in MCAP.
const BYTES_PER_POSE: f64 = 160.0;

/// One stream's share of the disk.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StreamSize {
    /// Its name.
    pub stream: &'static str,
    /// Its bytes.
    pub bytes: u64,
    /// Basis of the estimate.
    pub basis: String,
}

/// What the streams of a recording along `path` will need, uncompressed.
#[must_use]
pub(super) fn stream_sizes(path: &ToolPath, rig: &Rig) -> Vec<StreamSize> {
    let seconds = path.duration().as_secs_f64();
    let resting: f64 = path
        .steps()
        .iter()
        .filter(|step| step.curve.from() == step.curve.to() && step.curve.length().0 == 0.0)
        .map(|step| step.duration.as_secs_f64())
        .sum();
    let aps_seconds: f64 = path
        .steps()
        .iter()
        .filter(|step| step.settings.aps.unwrap_or(rig.davis.aps))
        .map(|step| step.duration.as_secs_f64())
        .sum();
    let n_events =
        (seconds - resting).max(0.0) * MOVING_EVENTS_PER_S + resting * RESTING_EVENTS_PER_S;
    let mut sizes = vec![
        StreamSize {
            stream: "events",
            bytes: (n_events * EVENT_BYTES as f64) as u64,
            basis: format!(
                "a budget of {:.1} M events/s while moving, {:.1} M at rest, {EVENT_BYTES} \
                 bytes each",
                MOVING_EVENTS_PER_S * 1e-6,
                RESTING_EVENTS_PER_S * 1e-6
            ),
        },
        StreamSize {
            stream: "imu",
            bytes: (seconds * IMU_BYTES_PER_S) as u64,
            basis: "1 kHz".to_owned(),
        },
        StreamSize {
            stream: "poses",
            bytes: (seconds * rig.arm.pose_rate.0 * BYTES_PER_POSE) as u64,
            basis: format!("{} per second", rig.arm.pose_rate.0),
        },
    ];
    if aps_seconds > 0.0 {
        sizes.push(frames("aps", &rig.davis.camera, aps_seconds, 16.0));
    }
    if rig.pi.raw {
        sizes.push(frames("raw", &rig.pi.camera, seconds, f64::from(rig.pi.raw_bits)));
    }
    if rig.pi.rgb {
        sizes.push(frames("rgb", &rig.pi.camera, seconds, 24.0));
    }
    sizes
}

fn frames(
    stream: &'static str,
    camera: &CameraDescription,
    seconds: f64,
    bits_per_pixel: f64,
) -> StreamSize {
    let n_pixels = camera.size.n_pixels() as f64;
    let bytes = seconds * camera.frame_rate.0 * n_pixels * bits_per_pixel / 8.0;
    let basis = format!(
        "{} pixels, {:.0} frames/s, {bits_per_pixel} bits per pixel",
        camera.size, camera.frame_rate.0
    );
    StreamSize { stream, bytes: bytes as u64, basis }
}
