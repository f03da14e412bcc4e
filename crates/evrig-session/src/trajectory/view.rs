//! Visibility of the target in each camera along a path.

use super::ToolPath;
use crate::rig::{CameraDescription, Mounting, Pose, Rig};
use evrig_core::time::Span;
use nalgebra::Vector3;
use serde::Serialize;

/// Sampling interval of the path, seconds.
const SAMPLING_INTERVAL_S: f64 = 0.02;
/// Largest number of samples.
const MAX_SAMPLES: f64 = 20_000.0;

/// The target in one camera's image along a path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TargetVisibility {
    /// Which camera.
    pub camera: &'static str,
    /// Pixels per millimetre of the target at its stand-off.
    pub pixels_per_mm: f64,
    /// Side of the tag in the image.
    pub tag_side_px: f64,
    /// The highest speed of the target in the image.
    pub peak_speed_px_per_s: f64,
    /// Share of the time in which the whole tag is in the image, 0..=1.
    pub tag_visible: f64,
    /// Share of the time in which the whole target is in the image, 0..=1.
    pub target_visible: f64,
}

/// The target in both cameras; empty when the rig does not state where the target is.
///
/// The lens is taken as free of distortion, and the target as parallel to the sensor.
pub(super) fn views(path: &ToolPath, rig: &Rig) -> Vec<TargetVisibility> {
    let Some(centre) = rig.target.centre else { return Vec::new() };
    let centre = Vector3::from(centre.map(|mm| mm.0));
    let corners = TargetCorners::of(rig, path.start(), centre);
    [("davis", &rig.mount.davis, &rig.davis.camera), ("pi", &rig.mount.pi, &rig.pi.camera)]
        .map(|(name, mounting, camera)| view(name, mounting, camera, path, rig, &corners))
        .to_vec()
}

/// TargetCorners of the tag and of the whole target in the base frame.
struct TargetCorners {
    tag: [Vector3<f64>; 4],
    all: [Vector3<f64>; 4],
}

impl TargetCorners {
    /// The target is upright in the DAVIS's image at the start pose, except for its own rotation.
    fn of(rig: &Rig, start: Pose, centre: Vector3<f64>) -> Self {
        let camera = rig.mount.davis.frame(start);
        let (sin, cos) = rig.target.rotation.0.to_radians().sin_cos();
        let right = cos * camera.right + sin * camera.down;
        let down = cos * camera.down - sin * camera.right;
        let (width, height) = (rig.target.width().0, rig.target.picture_side.0);
        let tag = rig.target.tag_side.0;
        let at = |x: f64, y: f64| centre + x * right + y * down;
        let rectangle = |x: [f64; 2], y: [f64; 2]| {
            [at(x[0], y[0]), at(x[1], y[0]), at(x[1], y[1]), at(x[0], y[1])]
        };
        let (half_width, half_height) = (width / 2.0, height / 2.0);
        Self {
            tag: rectangle([half_width - tag, half_width], [half_height - tag, half_height]),
            all: rectangle([-half_width, half_width], [-half_height, half_height]),
        }
    }
}

fn view(
    name: &'static str,
    mounting: &Mounting,
    camera: &CameraDescription,
    path: &ToolPath,
    rig: &Rig,
    corners: &TargetCorners,
) -> TargetVisibility {
    let seconds = path.duration().as_secs_f64();
    let n_samples = (seconds / SAMPLING_INTERVAL_S).ceil().clamp(1.0, MAX_SAMPLES);
    let (mut n_tag, mut n_all, mut fastest) = (0.0, 0.0, 0.0_f64);
    for i in 0..n_samples as usize {
        let time = (i as f64 + 0.5) * seconds / n_samples;
        let camera_at = |time: f64| mounting.frame(path.pose_at(Span::from_secs_f64(time)));
        let frame = camera_at(time);
        let pixel = |corner: &Vector3<f64>| camera.pixel(frame.to_camera(*corner));
        let sees = |four: &[Vector3<f64>; 4]| four.iter().all(|c| camera.sees(pixel(c)));
        n_tag += f64::from(u8::from(sees(&corners.tag)));
        n_all += f64::from(u8::from(sees(&corners.all)));
        let later = camera.pixel(camera_at(time + 1e-4).to_camera(corners.tag[0]));
        if let (Some(a), Some(b)) = (pixel(&corners.tag[0]), later) {
            fastest = fastest.max((b[0] - a[0]).hypot(b[1] - a[1]) / 1e-4);
        }
    }
    let pixels_per_mm = camera.pixels_per_mm(rig.target.stand_off);
    TargetVisibility {
        camera: name,
        pixels_per_mm,
        tag_side_px: rig.target.tag_side.0 * pixels_per_mm,
        peak_speed_px_per_s: fastest,
        tag_visible: n_tag / n_samples,
        target_visible: n_all / n_samples,
    }
}
