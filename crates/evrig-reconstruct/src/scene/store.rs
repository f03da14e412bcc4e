//! A scene as numbers that can be kept and read back without the frames.

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

/// A survey of the print and the event camera that is tied to it.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Columns and rows of the event camera.
    pub size: Size,
    /// The print and the path over it.
    pub survey: Survey,
    /// The event camera.
    pub registration: Registration,
}

/// Everything of a scene but its arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Columns and rows of the event camera.
    pub size: Size,
    /// How the print lies to the head.
    pub head: Head,
    /// Where the cells of the map lie.
    pub grid: MapGrid,
    /// The instant that the path's times count from.
    pub zero: Stamp<PiSensor>,
    /// Longest stretch between frames that the path leads across.
    pub max_gap: Span,
    /// Delay from row to row as the frames show it, seconds, with its standard error.
    pub row_s: [f64; 2],
    /// Gains of the mosaic's four places, row by row.
    pub site_gains: [f64; 4],
    /// Radiance of the brightest paper, DN above black.
    pub white_dn: f64,
    /// Share of the light that the Pi's lens loses in the corners, with its standard error.
    #[serde(default)]
    pub corner_loss: Option<[f64; 2]>,
    /// Noise of the Pi's readout, DN, with its standard error.
    #[serde(default)]
    pub read_noise_dn: Option<[f64; 2]>,
    /// Light that moves over the print.
    #[serde(default)]
    pub moving_light: Option<MovingLight>,
    /// Frames seen, and those that could not be put on the path.
    pub n_frames: [usize; 2],
    /// Frames put on the path without the tag.
    #[serde(default)]
    pub n_bridged: usize,
    /// The event camera.
    pub registration: Registration,
}

/// Columns of the path's table: time (s); x, y, distance (mm) and turn (rad); their standard errors;
/// logarithm of brightness; misfit.
pub const PATH_COLUMNS: usize = 11;

impl Scene {
    /// The drive of its event pixels.
    #[must_use]
    pub fn drive(&self) -> SceneDrive {
        SceneDrive::new(self.size, &self.survey, &self.registration)
    }

    /// Everything but the arrays.
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

    /// The path as a table of [`PATH_COLUMNS`] columns, row by row.
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

    /// The scene from its facts and arrays; None when their sizes do not fit together.
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
