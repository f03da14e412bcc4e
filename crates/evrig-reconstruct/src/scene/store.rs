//! A scene as parameters and arrays that are stored and read back without the frames.

use super::drive::SceneDrive;
use super::head::HeadGeometry;
use super::map::{MapGrid, RadianceMap};
use super::moving_illumination::MovingIllumination;
use super::path::{HeadPath, PathKnot};
use super::reconstruction::Reconstruction;
use super::registration::Registration;
use evrig_core::geometry::Size;
use evrig_core::time::{PiSensor, Span, Stamp};
use serde::{Deserialize, Serialize};

/// A reconstructed target with the event camera registered to it.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Columns and rows of the event camera.
    pub size: Size,
    /// The target and the path over it.
    pub reconstruction: Reconstruction,
    /// The event camera.
    pub registration: Registration,
}

/// Parameters of a scene without its arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneParameters {
    /// Columns and rows of the event camera.
    pub size: Size,
    /// Geometry of the camera head.
    pub head: HeadGeometry,
    /// Grid of the map.
    pub grid: MapGrid,
    /// Origin of the path's times.
    pub zero: Stamp<PiSensor>,
    /// Longest gap between frames that is interpolated.
    pub max_gap: Span,
    /// Row time measured from the frames, seconds, with its standard error.
    pub row_s: [f64; 2],
    /// Gains of the four Bayer sites, row by row.
    pub site_gains: [f64; 4],
    /// White level, DN above black.
    pub white_dn: f64,
    /// Vignetting of the Pi's lens at the corners, as a share of the light, with its standard
    /// error.
    #[serde(default)]
    pub corner_loss: Option<[f64; 2]>,
    /// Readout noise of the Pi, DN, with its standard error.
    #[serde(default)]
    pub read_noise_dn: Option<[f64; 2]>,
    /// Illumination that moves over the target.
    #[serde(default, alias = "moving_light")]
    pub moving_illumination: Option<MovingIllumination>,
    /// All frames, and those without a pose.
    pub n_frames: [usize; 2],
    /// Frames located without the tag.
    #[serde(default)]
    pub n_bridged: usize,
    /// The event camera.
    pub registration: Registration,
}

/// Columns of the path's table: time (s); x, y, distance (mm) and wrist rotation (rad); their
/// standard errors; log brightness; misfit.
pub const PATH_COLUMNS: usize = 11;

impl Scene {
    /// The log-intensity signal of its event pixels.
    #[must_use]
    pub fn drive(&self) -> SceneDrive {
        SceneDrive::new(self.size, &self.reconstruction, &self.registration)
    }

    /// All parameters without the arrays.
    #[must_use]
    pub fn parameters(&self) -> SceneParameters {
        let reconstruction = &self.reconstruction;
        SceneParameters {
            size: self.size,
            head: reconstruction.head,
            grid: reconstruction.map.grid,
            zero: reconstruction.path.zero,
            max_gap: reconstruction.path.max_gap,
            row_s: reconstruction.row_s,
            site_gains: reconstruction.site_gains,
            white_dn: reconstruction.white_dn,
            corner_loss: reconstruction.corner_loss,
            read_noise_dn: reconstruction.read_noise_dn,
            moving_illumination: reconstruction.moving_illumination.clone(),
            n_frames: reconstruction.n_frames,
            n_bridged: reconstruction.n_bridged,
            registration: self.registration.clone(),
        }
    }

    /// The path as a table of [`PATH_COLUMNS`] columns, row-major.
    #[must_use]
    pub fn path_table(&self) -> Vec<f64> {
        let row = |knot: &PathKnot| {
            let mut row = vec![knot.time_s];
            row.extend(knot.pose.iter().chain(&knot.pose_error));
            row.extend([knot.ln_gain, knot.misfit]);
            row
        };
        self.reconstruction.path.knots.iter().flat_map(row).collect()
    }

    /// The scene from its parameters and arrays; None when their sizes do not match.
    #[must_use]
    pub fn from_parts(
        parameters: SceneParameters,
        map: Vec<f32>,
        errors: Vec<f32>,
        path_table: &[f64],
    ) -> Option<Self> {
        let n = parameters.grid.width.checked_mul(parameters.grid.height)?;
        if map.len() != n || errors.len() != n || !path_table.len().is_multiple_of(PATH_COLUMNS) {
            return None;
        }
        let knot = |row: &[f64]| PathKnot {
            time_s: row[0],
            pose: std::array::from_fn(|i| row[1 + i]),
            pose_error: std::array::from_fn(|i| row[5 + i]),
            ln_gain: row[9],
            misfit: row[10],
        };
        let knots = path_table.chunks_exact(PATH_COLUMNS).map(knot).collect();
        let reconstruction = Reconstruction {
            head: parameters.head,
            map: RadianceMap::new(parameters.grid, map, errors),
            path: HeadPath::new(parameters.zero, knots, parameters.max_gap),
            row_s: parameters.row_s,
            site_gains: parameters.site_gains,
            white_dn: parameters.white_dn,
            corner_loss: parameters.corner_loss,
            read_noise_dn: parameters.read_noise_dn,
            moving_illumination: parameters.moving_illumination,
            n_frames: parameters.n_frames,
            n_bridged: parameters.n_bridged,
        };
        Some(Self { size: parameters.size, reconstruction, registration: parameters.registration })
    }
}
