//! Misregistration: the registration of the event camera is wrong.
//!
//! The real image is shifted, rotated about the middle of the sensor and scaled against the drive.
//! Signature: a lag of shift over velocity that turns its sign with the direction of motion.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;

effect! {
    /// A similarity between predicted and real places.
    Misregistration, Optics, "p_real = middle + s R (p - middle) + shift" {
        /// Real less predicted column, event pixels.
        shift_x_px: -200.0 to 200.0,
        /// Real less predicted row, event pixels.
        shift_y_px: -200.0 to 200.0,
        /// From the predicted to the real image, degrees, x towards y.
        rotation_deg: -180.0 to 180.0,
        /// Real over predicted size.
        scale: 0.1 to 10.0,
    }
}

impl EffectModel for Misregistration {
    fn drive_place(&self, site: &PixelSite<'_>, place: [f64; 2]) -> [f64; 2] {
        let middle = [site.size.width, site.size.height].map(|n| 0.5 * f64::from(n));
        let (sin, cos) = self.rotation_deg.to_radians().sin_cos();
        let x = place[0] - middle[0] - self.shift_x_px;
        let y = place[1] - middle[1] - self.shift_y_px;
        let back = |a: f64| a / self.scale;
        [middle[0] + back(cos * x + sin * y), middle[1] + back(cos * y - sin * x)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::test_support::*;

    #[test]
    fn a_pixel_sees_what_was_predicted_for_the_place_that_was_moved_onto_it() {
        let context = crate::effect::pixel_site::RecordingContext::default();
        let source = crate::random::RandomSource::new(0);
        let site = PixelSite { x: 40, y: 10, size: SIZE, white_dn: 1.0, context: &context, source };
        let moved =
            Misregistration { shift_x_px: 2.0, shift_y_px: -1.0, rotation_deg: 30.0, scale: 1.1 };
        let [x, y] = moved.drive_place(&site, [40.5, 10.5]);
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let real = [
            30.0 + 1.1 * (cos * (x - 30.0) - sin * (y - 20.0)) + 2.0,
            20.0 + 1.1 * (sin * (x - 30.0) + cos * (y - 20.0)) - 1.0,
        ];
        assert!((real[0] - 40.5).abs() < 1e-12 && (real[1] - 10.5).abs() < 1e-12);
    }

    #[test]
    fn the_lag_turns_with_the_direction_of_motion() {
        let words = ["misregistration:shift_x_px=0.8,shift_y_px=0,rotation_deg=0,scale=1"];
        for px_per_s in [32.0, -32.0] {
            let light = synthetic(move |[x, _], t| {
                0.5 * (std::f64::consts::TAU * (x - px_per_s * t) / 16.0).sin() - 1.0
            });
            let found = phase_lag(&events(&light, 4.0, &[]), &events(&light, 4.0, &words), 2.0);
            // Moved along with the motion, an edge is there earlier.
            let expected = -0.8 / px_per_s * 1e6;
            assert!((found / expected - 1.0).abs() < 0.15, "{found} for {expected}");
        }
    }
}
