//! The event camera's picture against the map's: where it lies and how blurred it is, to first order.

use crate::diagnose::Nuisance;
use serde::{Deserialize, Serialize};

/// By how much the real picture lies elsewhere than the predicted one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImagePose {
    /// Real minus predicted place of the sensor's middle, pixels.
    pub shift_px: [f64; 2],
    /// Real minus predicted rotation about it, degrees.
    pub rotation_deg: f64,
    /// Real over predicted size, less one.
    #[serde(alias = "growth")]
    pub scale_change: f64,
}

impl ImagePose {
    /// The nuisances that it consists of.
    pub(crate) const NUISANCES: [Nuisance; 4] =
        [Nuisance::ShiftX, Nuisance::ShiftY, Nuisance::RotationDeg, Nuisance::ScaleChange];

    /// Out of the values of the nuisances.
    pub(crate) fn of(values: &[f64]) -> Self {
        let [x, y, rotation_deg, scale_change] = Self::NUISANCES.map(|n| values[n as usize]);
        Self { shift_px: [x, y], rotation_deg, scale_change }
    }

    /// The place in the predicted picture that is seen at a place of the sensor. What is seen lies opposite
    /// to where the picture has gone.
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
    fn a_picture_that_has_turned_and_grown_is_seen_where_it_was() {
        let pose = ImagePose { shift_px: [0.5, -0.25], rotation_deg: 0.05, scale_change: 1e-3 };
        let middle = [173.0, 130.0];
        let was = [300.0, 40.0];
        let angle = 0.05_f64.to_radians();
        let [x, y] = [was[0] - middle[0], was[1] - middle[1]];
        // The picture turned about the middle, then moved, exactly.
        let now = [
            middle[0] + 1.001 * (x * angle.cos() - y * angle.sin()) + 0.5,
            middle[1] + 1.001 * (x * angle.sin() + y * angle.cos()) - 0.25,
        ];
        let seen = pose.source_of(now, middle);
        assert!((seen[0] - was[0]).hypot(seen[1] - was[1]) < 2e-3, "{seen:?}");
    }
}
