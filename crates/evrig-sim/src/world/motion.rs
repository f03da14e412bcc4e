//! The true motion of the tool: the arm's path with vibration.

use super::effects::Vibration;
use evrig_core::time::Span;
use evrig_core::units::Millimetres;
use evrig_session::rig::Pose;
use evrig_session::trajectory::ToolPath;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Pose of the tool over world time (zero is the beginning of the path).
pub trait ToolMotion: Send + Sync + std::fmt::Debug {
    /// The pose at `time`; a pure function of it.
    fn pose_at(&self, time: Span) -> Pose;

    /// Speed of the tool point at `time`, in mm/s.
    fn speed_at(&self, time: Span) -> f64 {
        let step = Span::from_micros(500);
        let way = self.pose_at(time - step).distance(self.pose_at(time + step));
        way.0 / (2.0 * step.as_secs_f64())
    }
}

impl ToolMotion for ToolPath {
    fn pose_at(&self, time: Span) -> Pose {
        Self::pose_at(self, time)
    }
}

/// The tool swings at full amplitude from this speed on.
const FULL_SWING_MM_PER_S: f64 = 10.0;

/// A vibration about the arm's path.
#[derive(Debug, Clone, Copy)]
pub(super) struct ToolVibration {
    /// Amplitude and direction in the base frame, millimetres.
    way_mm: Vector3<f64>,
    frequency_hz: f64,
}

impl ToolVibration {
    /// `right` and `down` are those of the DAVIS's image at the beginning.
    pub(super) fn new(vibration: Vibration, right: Vector3<f64>, down: Vector3<f64>) -> Self {
        let (sin, cos) = vibration.direction_deg.to_radians().sin_cos();
        let way_mm = (cos * right + sin * down) * vibration.amplitude_mm;
        Self { way_mm, frequency_hz: vibration.frequency_hz }
    }

    pub(super) fn frequency_hz(&self) -> f64 {
        self.frequency_hz
    }

    /// The pose with the swing on top of it.
    pub(super) fn applied(&self, pose: Pose, speed_mm_per_s: f64, time_s: f64) -> Pose {
        let share = (speed_mm_per_s / FULL_SWING_MM_PER_S).clamp(0.0, 1.0);
        let by = self.way_mm * share * (TAU * self.frequency_hz * time_s).sin();
        let [x, y, z] = pose.position_mm();
        let [x, y, z] = [x + by.x, y + by.y, z + by.z].map(Millimetres);
        Pose { x, y, z, r: pose.r }
    }
}
