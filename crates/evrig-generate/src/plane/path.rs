//! The motion of a plane in the image of a camera.

use evrig_core::geometry::Homography;

/// The motion of a plane in the image of a camera.
///
/// *Ideal* pixels are those of the same camera with a perfect lens. Pixel `i` covers `i..i + 1`.
pub trait PlanePath: Send + Sync {
    /// Homography from plane to ideal pixels at a time of the frames' clock, µs; none where it is
    /// unknown.
    fn pixel_from_plane(&self, t_us: f64) -> Option<Homography>;

    /// The sensor pixel of an ideal pixel.
    fn distort(&self, ideal: [f64; 2]) -> [f64; 2] {
        ideal
    }

    /// The ideal pixel of a sensor pixel; none where the distortion cannot be inverted.
    fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        Some(pixel)
    }

    /// Whether the lens has distortion, so that ideal pixels differ from the sensor's.
    fn has_distortion(&self) -> bool {
        false
    }
}
