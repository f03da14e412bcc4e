//! The survey: from the Pi's raw frames and the tag's track to the map and the head's path.

use super::error::SceneError;
use super::head::Head;
use super::map::RadianceMap;
use super::mosaic::RawLight;
use super::moving_light::MovingLight;
use super::path::HeadPath;
use super::surveyor::Surveyor;
use crate::roi::{Lens, Track};
use evrig_core::frame::Frame;
use evrig_core::geometry::Size;
use evrig_core::time::{PiSensor, Span};
use evrig_session::rig::Mount;
use nalgebra::Vector3;

/// What is shown every frame, with its number.
pub type Seeing<'a> = dyn FnMut(usize, &Frame<PiSensor>) -> Result<(), SceneError> + 'a;

/// The Pi's raw frames, which can be gone through more than once.
pub trait Footage {
    /// Why a frame cannot be read.
    type Error: From<SceneError>;

    /// Shows every frame in order of time with its number from 0.
    ///
    /// # Errors
    /// When a frame cannot be read, or `see` refuses one.
    fn replay(&mut self, see: &mut Seeing<'_>) -> Result<(), Self::Error>;
}

impl Footage for &[Frame<PiSensor>] {
    type Error = SceneError;

    fn replay(&mut self, see: &mut Seeing<'_>) -> Result<(), SceneError> {
        self.iter().enumerate().try_for_each(|(index, frame)| see(index, frame))
    }
}

/// What is known of the Pi camera before its frames are looked at.
#[derive(Debug, Clone, Copy)]
pub struct PiKnown<'a> {
    /// Size of its frames.
    pub size: Size,
    /// Its lens.
    pub lens: Lens,
    /// What its samples mean.
    pub raw: RawLight,
    /// Delay from row to row as stated.
    pub row_time: Span,
    /// Where both cameras sit.
    pub mount: Mount,
    /// The tag as its frames show it.
    pub track: &'a Track<PiSensor>,
}

/// What the Pi's frames tell: the print and the path over it.
#[derive(Debug, Clone)]
pub struct Survey {
    /// How the print lies to the head.
    pub head: Head,
    /// The map of the print.
    pub map: RadianceMap,
    /// The head's path, a knot a frame.
    pub path: HeadPath,
    /// Delay from row to row as the frames show it, seconds, with its standard error. Within 15 %
    /// the path goes by the stated one all the same, which a camera keeps better than that.
    pub row_s: [f64; 2],
    /// Gains of the mosaic's four places, row by row.
    pub site_gains: [f64; 4],
    /// Radiance of the brightest paper, DN above black.
    pub white_dn: f64,
    /// Share of the light that the Pi's lens loses in the corners of its frames, with its standard error;
    /// none for a head that stood.
    pub corner_loss: Option<[f64; 2]>,
    /// Noise of the Pi's readout, DN, with its standard error; none where nothing smooth was seen.
    pub read_noise_dn: Option<[f64; 2]>,
    /// Light that moves over the print; the map and the path are free of it.
    pub moving_light: Option<MovingLight>,
    /// Frames seen, and those that could not be put on the path.
    pub n_frames: [usize; 2],
    /// Frames that were put on the path without the tag, from the frames beside them and the map.
    pub n_bridged: usize,
}

impl Survey {
    /// Share of the light that reaches a place of the print at a time of the path, for what moves over it.
    #[must_use]
    pub fn passing(&self, place_mm: [f64; 2], time_s: f64) -> f64 {
        self.moving_light.as_ref().map_or(1.0, |light| light.ln_at(place_mm, time_s).exp())
    }

    /// The same survey of frames whose light is to be taken to a power: white stays white.
    #[must_use]
    pub fn raised(mut self, power: f64) -> Self {
        let white = self.white_dn as f32;
        let map = &mut self.map;
        let cells = map.radiance.values.iter_mut().zip(&mut map.errors);
        // Where nothing is mapped nothing is to come.
        for (value, error) in cells.filter(|(value, _)| value.is_finite()) {
            let share = (*value / white).max(0.0);
            *value = white * share.powf(power as f32);
            *error *= power as f32 * share.powf(power as f32 - 1.0);
        }
        let mut knots = std::mem::take(&mut self.path.knots);
        knots.iter_mut().for_each(|knot| knot.ln_gain *= power);
        self.path = HeadPath::new(self.path.zero, knots, self.path.max_gap);
        self.moving_light = self.moving_light.map(|light| light.raised(power));
        self
    }

    /// Millimetres on the print that a ray of the Pi camera (right and down over forward) looks at;
    /// `time_s` counts from the path's zero.
    #[must_use]
    pub fn place_mm(&self, [u, v]: [f64; 2], time_s: f64) -> Option<[f64; 2]> {
        let place = self.head.plane_from_pi(&self.path.pose(time_s)?)? * Vector3::new(u, v, 1.0);
        Some([place.x / place.z, place.y / place.z])
    }
}

/// Rounds of map, poses and shared constants; and when the map is made anew with more frames.
const ROUNDS: usize = 4;
const MORE_ROUNDS: usize = 2;

/// How often frames without the tag may extend the map,
const EXTENSIONS: usize = 5;

/// and the share of all frames from which on it is worth it.
const WORTH: f64 = 0.02;

/// Makes the map of the print and the head's path over it.
///
/// # Errors
/// When frames cannot be read, too few show the tag, or nothing on the print stands out.
pub fn survey<F: Footage>(known: &PiKnown<'_>, footage: &mut F) -> Result<Survey, F::Error> {
    let mut work = Surveyor::new(known)?;
    work.take_keys(footage)?;
    let mut made = work.make_map(ROUNDS)?;
    let mut followed = work.follow(footage, &made)?;
    for _ in 0..EXTENSIONS {
        // Frames without the tag show parts of the print that no frame with it does.
        if (followed.n_bridged as f64) < WORTH * followed.n_frames[0] as f64 {
            break;
        }
        let n_known = followed.path.knots.len();
        work.go_by(followed.path);
        work.take_keys(footage)?;
        made = work.make_map(MORE_ROUNDS)?;
        followed = work.follow(footage, &made)?;
        if (followed.path.knots.len() as f64) < (1.0 + WORTH) * n_known as f64 {
            break;
        }
    }
    let mut map = made.map;
    if let Some(moving) = &followed.moving {
        moving.free(&mut map);
    }
    Ok(Survey {
        head: work.head(),
        path: followed.path,
        row_s: [work.row_found_s(), made.row_error_s],
        site_gains: work.site_gains(),
        white_dn: made.white_dn,
        corner_loss: made.corner_loss,
        read_noise_dn: made.read_noise_dn,
        moving_light: followed.moving.map(|moving| moving.light),
        n_frames: followed.n_frames,
        n_bridged: followed.n_bridged,
        map,
    })
}
