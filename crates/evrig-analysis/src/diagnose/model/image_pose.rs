//! Pose of the event camera's image against the predicted one.

use serde::{Deserialize, Serialize};

/// Difference between recorded and predicted image.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImagePose {
    /// Recorded minus predicted position of the sensor's center, pixels.
    pub shift_px: [f64; 2],
    /// Recorded minus predicted rotation about the center, degrees.
    pub rotation_deg: f64,
    /// Recorded over predicted scale, minus one.
    #[serde(alias = "growth")]
    pub scale_change: f64,
}

impl ImagePose {
    /// Point of the predicted image that is source at a point of the sensor, to first order.
    pub(crate) fn source_of(self, place: [f64; 2], middle: [f64; 2]) -> [f64; 2] {
        let [x, y] = [place[0] - middle[0], place[1] - middle[1]];
        let angle = self.rotation_deg.to_radians();
        let dx = self.shift_px[0] + self.scale_change * x - angle * y;
        let dy = self.shift_px[1] + self.scale_change * y + angle * x;
        [place[0] - dx, place[1] - dy]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn source_of_inverts_a_small_rotation_and_scaling() {
        let pose = ImagePose { shift_px: [0.5, -0.25], rotation_deg: 0.05, scale_change: 1e-3 };
        let middle = [173.0, 130.0];
        let was = [300.0, 40.0];
        let angle = 0.05_f64.to_radians();
        let [x, y] = [was[0] - middle[0], was[1] - middle[1]];
        // The exact rotation, scaling and shift.
        let now = [
            middle[0] + 1.001 * (x * angle.cos() - y * angle.sin()) + 0.5,
            middle[1] + 1.001 * (x * angle.sin() + y * angle.cos()) - 0.25,
        ];
        let source = pose.source_of(now, middle);
        assert!((source[0] - was[0]).hypot(source[1] - was[1]) < 2e-3, "{source:?}");
    }
}
