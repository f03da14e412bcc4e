//! Whether the simulated cameras kept up with the clock.

use evrig_session::rig::{CameraDescription, CameraTransport, Rig};
use evrig_session::{Manifest, StreamKind};

/// Share of the frames due below which a simulated camera was too slow.
const MIN_SHARE: f64 = 0.9;

/// A sentence for each simulated camera that delivered fewer frames than the rig file states: a
/// busy machine renders the world slower than real time.
pub(super) fn slow_cameras(rig: &Rig, manifest: &Manifest) -> Vec<String> {
    let cameras = [("aps", &rig.davis.camera), ("raw", &rig.pi.camera), ("rgb", &rig.pi.camera)];
    let slow = |(name, camera): (&str, &CameraDescription)| {
        let is_frames = |kind| kind == StreamKind::Frames;
        let stream = manifest.streams.iter().find(|s| s.name == name && is_frames(s.kind))?;
        let seconds = (stream.last_us? - stream.first_us?) as f64 * 1e-6;
        let (rate, due) = (stream.count.saturating_sub(1) as f64 / seconds, camera.frame_rate.0);
        let is_slow = camera.transport == CameraTransport::Sim && rate < MIN_SHARE * due;
        is_slow.then(|| {
            format!(
                "{name}: {rate:.0} of {due:.0} frames a second, because this machine simulates \
                 the camera slower than real time"
            )
        })
    };
    cameras.into_iter().filter_map(slow).collect()
}
