//! A scene as parameters and arrays that are stored and read back without the frames.

use super::drive::SceneDrive;
use super::head::Head;
use super::map::{MapGrid, RadianceMap};
use super::moving_light::MovingLight;
use super::path::{HeadPath, PathKnot};
use super::register::Registration;
use super::survey::Survey;
use evrig_core::geometry::Size;
use evrig_core::time::{PiSensor, Span, Stamp};
use serde::{Deserialize, Serialize};

/// A reconstructed target with the event camera registered to it.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Columns and rows of the event camera.
    pub size: Size,
    /// The target and the path over it.
    pub survey: Survey,
    /// The event camera.
    pub registration: Registration,
}

/// Parameters of a scene without its arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Columns and rows of the event camera.
    pub size: Size,
    /// Geometry of the camera head.
    pub head: Head,
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
    #[serde(default)]
    pub moving_light: Option<MovingLight>,
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
        SceneDrive::new(self.size, &self.survey, &self.registration)
    }

    /// All parameters without the arrays.
    #[must_use]
    pub fn facts(&self) -> SceneFacts {
        let survey = &self.survey;
        SceneFacts {
            size: self.size,
            head: survey.head,
            grid: survey.map.grid,
            zero: survey.path.zero,
            max_gap: survey.path.max_gap,
            row_s: survey.row_s,
            site_gains: survey.site_gains,
            white_dn: survey.white_dn,
            corner_loss: survey.corner_loss,
            read_noise_dn: survey.read_noise_dn,
            moving_light: survey.moving_light.clone(),
            n_frames: survey.n_frames,
            n_bridged: survey.n_bridged,
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
        self.survey.path.knots.iter().flat_map(row).collect()
    }

    /// The scene from its parameters and arrays; None when their sizes do not match.
    #[must_use]
    pub fn from_parts(
        facts: SceneFacts,
        map: Vec<f32>,
        errors: Vec<f32>,
        path_table: &[f64],
    ) -> Option<Self> {
        let n = facts.grid.width.checked_mul(facts.grid.height)?;
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
        let survey = Survey {
            head: facts.head,
            map: RadianceMap::new(facts.grid, map, errors),
            path: HeadPath::new(facts.zero, knots, facts.max_gap),
            row_s: facts.row_s,
            site_gains: facts.site_gains,
            white_dn: facts.white_dn,
            corner_loss: facts.corner_loss,
            read_noise_dn: facts.read_noise_dn,
            moving_light: facts.moving_light,
            n_frames: facts.n_frames,
            n_bridged: facts.n_bridged,
        };
        Some(Self { size: facts.size, survey, registration: facts.registration })
    }
}
