//! Pixels of a frame compared with the map on a regular subset.

use super::accumulate::{Keyframe, MapOptics};
use super::map::RadianceMap;
use nalgebra::Vector3;

/// A pixel and the map at the point it views.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapSample {
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) place_mm: [f64; 2],
    /// Light of the pixel, DN of green above black.
    pub(super) light: f64,
    /// Radiance of the map and its gradient per millimetre.
    pub(super) mapped: [f64; 3],
}

/// Visits every `step`-th pixel of every `step`-th row that views the map. An odd step covers all
/// Bayer sites.
pub(super) fn visit_map_samples(
    optics: &MapOptics,
    map: &RadianceMap,
    key: &Keyframe,
    step: usize,
    mut visit: impl FnMut(&MapSample),
) -> Option<()> {
    let camera = &optics.camera;
    let (width, height) = (usize::from(camera.size.width), usize::from(camera.size.height));
    for y in (0..height).step_by(step) {
        let plane = optics.head.plane_from_pi(&optics.pose_of_row(key, y as f64))?;
        for x in (0..width).step_by(step) {
            let Some(light) = camera.light(&key.samples, x, y) else { continue };
            let [u, v] = camera.ray(x, y);
            let place = plane * Vector3::new(u, v, 1.0);
            let place_mm = [place.x / place.z, place.y / place.z];
            let mapped = map.sample(place_mm);
            if mapped[0].is_finite() {
                visit(&MapSample { x, y, place_mm, light: f64::from(light), mapped });
            }
        }
    }
    Some(())
}
