//! Reconstruction of the target and the head's path from the Pi's raw frames and the tag's track.

use super::head::HeadGeometry;
use super::map::RadianceMap;
use super::map_builder::MapBuilder;
use super::moving_illumination::MovingIllumination;
use super::path::HeadPath;
use super::pi_inputs::{PiInputs, RawFrames};
use nalgebra::Vector3;

/// Target and path reconstructed from the Pi's frames.
#[derive(Debug, Clone)]
pub struct Reconstruction {
    /// Geometry of the camera head.
    pub head: HeadGeometry,
    /// Radiance map of the target.
    pub map: RadianceMap,
    /// Path of the head, one knot per frame.
    pub path: HeadPath,
    /// Row time measured from the frames, seconds, with its standard error. Within 15 % of the
    /// nominal one the path uses the nominal one, which is more accurate.
    pub row_s: [f64; 2],
    /// Gains of the four Bayer sites, row by row.
    pub site_gains: [f64; 4],
    /// White level, DN above black.
    pub white_dn: f64,
    /// Vignetting of the Pi's lens at the corners, as a share of the light, with its standard
    /// error; None for a head at rest.
    pub corner_loss: Option<[f64; 2]>,
    /// Readout noise of the Pi, DN, with its standard error; None with too few smooth samples.
    pub read_noise_dn: Option<[f64; 2]>,
    /// Illumination that moves over the target; it is removed from the map and the path.
    pub moving_illumination: Option<MovingIllumination>,
    /// All frames, and those without a pose.
    pub n_frames: [usize; 2],
    /// Frames located without the tag, from their neighbours and the map.
    pub n_bridged: usize,
}

impl Reconstruction {
    /// Relative illumination at a target position and path time from [`Self::moving_illumination`].
    #[must_use]
    pub fn illumination(&self, place_mm: [f64; 2], time_s: f64) -> f64 {
        self.moving_illumination.as_ref().map_or(1.0, |light| light.ln_at(place_mm, time_s).exp())
    }

    /// The reconstruction of frames whose light is raised to a power; white is kept.
    #[must_use]
    pub fn with_power(mut self, power: f64) -> Self {
        let white = self.white_dn as f32;
        let map = &mut self.map;
        let cells = map.radiance.values.iter_mut().zip(&mut map.errors);
        // Unobserved cells stay `NaN`.
        for (value, error) in cells.filter(|(value, _)| value.is_finite()) {
            let share = (*value / white).max(0.0);
            *value = white * share.powf(power as f32);
            *error *= power as f32 * share.powf(power as f32 - 1.0);
        }
        let mut knots = std::mem::take(&mut self.path.knots);
        knots.iter_mut().for_each(|knot| knot.ln_gain *= power);
        self.path = HeadPath::new(self.path.zero, knots, self.path.max_gap);
        self.moving_illumination = self.moving_illumination.map(|light| light.with_power(power));
        self
    }

    /// Target position in millimetres viewed by a ray of the Pi camera (right and down over
    /// forward); `time_s` counts from the path's zero.
    #[must_use]
    pub fn place_mm(&self, [u, v]: [f64; 2], time_s: f64) -> Option<[f64; 2]> {
        let place = self.head.plane_from_pi(&self.path.pose(time_s)?)? * Vector3::new(u, v, 1.0);
        Some([place.x / place.z, place.y / place.z])
    }
}

/// Alternating rounds of map, poses and shared constants, at first and after the map was extended.
const MAP_ROUNDS: usize = 4;
const EXTENSION_ROUNDS: usize = 2;
/// Most extensions of the map by frames without the tag.
const MAX_EXTENSIONS: usize = 5;
/// Least share of all frames for another extension.
const MIN_EXTENSION_SHARE: f64 = 0.02;

/// Reconstructs the radiance map of the target and the head's path over it.
///
/// # Errors
/// When frames cannot be read, too few show the tag, or the target has no texture.
pub fn reconstruct_target<F: RawFrames>(
    inputs: &PiInputs<'_>,
    source: &mut F,
) -> Result<Reconstruction, F::Error> {
    let mut builder = MapBuilder::new(inputs)?;
    builder.select_keyframes(source)?;
    let mut built = builder.build_map(MAP_ROUNDS)?;
    let mut located = builder.locate_frames(source, &built)?;
    for _ in 0..MAX_EXTENSIONS {
        // Frames without the tag cover parts of the target that no frame with it does.
        if (located.n_bridged as f64) < MIN_EXTENSION_SHARE * located.n_frames[0] as f64 {
            break;
        }
        let n_known = located.path.knots.len();
        builder.previous_path = Some(located.path);
        builder.select_keyframes(source)?;
        built = builder.build_map(EXTENSION_ROUNDS)?;
        located = builder.locate_frames(source, &built)?;
        if (located.path.knots.len() as f64) < (1.0 + MIN_EXTENSION_SHARE) * n_known as f64 {
            break;
        }
    }
    let mut map = built.map;
    if let Some(illumination) = &located.illumination {
        illumination.remove_from(&mut map);
    }
    Ok(Reconstruction {
        head: builder.optics.head,
        path: located.path,
        row_s: [builder.measured_row_s, built.row_error_s],
        site_gains: builder.optics.camera.gains(),
        white_dn: built.white_dn,
        corner_loss: built.corner_loss,
        read_noise_dn: built.read_noise_dn,
        moving_illumination: located.illumination.map(|illumination| illumination.light),
        n_frames: located.n_frames,
        n_bridged: located.n_bridged,
        map,
    })
}
