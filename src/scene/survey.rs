//! The survey: from the Pi's raw frames and the tag's track to the map and the head's path.

use super::align::{Noise, Reference, SHARED};
use super::error::SceneError;
use super::head::Head;
use super::locate::{locate, split};
use super::map::{MapGrid, RadianceMap};
use super::mosaic::{PiCamera, RawLight};
use super::path::{HeadPath, PathKnot};
use super::splat::{Key, Optics, site_ratios, splat};
use super::start::TagPath;
use crate::frame::Frame;
use crate::geometry::Size;
use crate::rig::Mount;
use crate::roi::{Lens, Track};
use crate::time::{PiSensor, Span};
use nalgebra::{SMatrix, SVector, Vector3};
use rayon::prelude::*;

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
    /// the path goes by the stated one all the same: the frames' own is biased by some percent.
    pub row_s: [f64; 2],
    /// Gains of the mosaic's four places, row by row.
    pub site_gains: [f64; 4],
    /// Radiance of the brightest paper, DN above black.
    pub white_dn: f64,
    /// Frames seen, and those that could not be put on the path.
    pub n_frames: [usize; 2],
}

/// Frames that the map is made of, at most.
const KEYS: usize = 150;

/// Fewer frames make no map.
const LEAST_KEYS: usize = 12;

/// Cells of the map that frames are held against.
const MARKS: usize = 24_000;

/// Rounds of map, poses and shared constants.
const ROUNDS: usize = 4;

/// Side of a cell in Pi pixels.
const CELL_PX: f64 = 0.8;

/// Most cells of a map.
const MAX_CELLS: usize = 6_000_000;

/// Longest stretch between frames that the path leads across.
const MAX_GAP: Span = Span::from_micros(50_000);

/// A frame whose logarithm of brightness is farther from the others' is left out of the map.
const STRANGE_LIGHT: f64 = 0.03;

/// Standard deviations of what is known before: tilts of the print and of the wrist's axis (radians).
const TILT_RAD: f64 = 0.02;

/// And of the row time, as a share of what is stated.
const ROW_SHARE: f64 = 0.2;

/// A row time that differs from the stated one by a smaller share is not believed.
const ROW_BELIEF: f64 = 0.15;

/// Pixels are wrong together: so many count as one against what is known before. A late row, a tilt
/// and a distance that changes look alike along one circle.
const ALIKE: f64 = 1_000.0;

impl Survey {
    /// Millimetres on the print that a ray of the Pi camera (right and down over forward) looks at;
    /// `time_s` counts from the path's zero.
    #[must_use]
    pub fn place_mm(&self, [u, v]: [f64; 2], time_s: f64) -> Option<[f64; 2]> {
        let place = self.head.plane_from_pi(&self.path.pose(time_s)?)? * Vector3::new(u, v, 1.0);
        Some([place.x / place.z, place.y / place.z])
    }
}

/// The work in progress.
struct Surveyor<'a> {
    tag: TagPath<'a>,
    optics: Optics,
    stated_row_s: f64,
    /// What the frames say of the row time.
    row_found_s: f64,
    keys: Vec<Key>,
    noise: Noise,
}

/// Makes the map of the print and the head's path over it.
///
/// # Errors
/// When frames cannot be read, too few show the tag, or nothing on the print stands out.
pub fn survey<F: Footage>(known: &PiKnown<'_>, footage: &mut F) -> Result<Survey, F::Error> {
    let mut work = Surveyor::new(known)?;
    work.take_keys(footage)?;
    let (map, row_error_s) = work.make_map()?;
    let white_dn = map.white_dn().ok_or(SceneError::NoTexture)?;
    let (path, n_frames) = work.follow(footage, &map, white_dn)?;
    Ok(Survey {
        head: work.optics.head,
        path,
        row_s: [work.row_found_s, row_error_s],
        site_gains: work.optics.camera.gains(),
        white_dn,
        n_frames,
        map,
    })
}

impl<'a> Surveyor<'a> {
    fn new(known: &PiKnown<'a>) -> Result<Self, SceneError> {
        let none = SceneError::TooFewFrames { found: 0, n: 0, needed: LEAST_KEYS };
        let tag = TagPath::new(known.track, Head::stated(&known.mount)).ok_or(none)?;
        let camera = PiCamera::new(known.size, known.lens, known.raw);
        let row_s = known.row_time.as_secs_f64();
        let optics = Optics { camera, head: tag.head, row_s };
        let noise = Noise { variance_per_dn: 1.0, floor_dn: 10.0 };
        Ok(Self { tag, optics, stated_row_s: row_s, row_found_s: row_s, keys: Vec::new(), noise })
    }

    fn key(&self, index: usize, frame: &Frame<PiSensor>) -> Result<Option<Key>, SceneError> {
        let first_s = self.first_s(frame);
        let Some((pose, speed)) = self.tag.pose(self.optics.middle_s(first_s)) else {
            return Ok(None);
        };
        let samples = self.optics.camera.samples(index, frame)?;
        let exposure_s = frame.timing.exposure.map_or(0.0, |[from, to]| (to - from).as_secs_f64());
        Ok(Some(Key { samples, first_s, exposure_s, pose, speed, ln_gain: 0.0 }))
    }

    /// Mid-exposure of a frame's first row.
    fn first_s(&self, frame: &Frame<PiSensor>) -> f64 {
        (frame.timing.mid_exposure(0) - self.tag.zero()).as_secs_f64()
    }

    /// Keeps frames at equal steps of time.
    fn take_keys<F: Footage>(&mut self, footage: &mut F) -> Result<(), F::Error> {
        let [from, to] = self.tag.span_s();
        let step_s = ((to - from) / KEYS as f64).max(1e-6);
        let mut next_s = from;
        let (mut n, mut found) = (0, 0);
        let mut keys = Vec::new();
        footage.replay(&mut |index, frame| {
            n += 1;
            let time_s = self.optics.middle_s(self.first_s(frame));
            if time_s >= next_s
                && let Some(key) = self.key(index, frame)?
            {
                next_s = (next_s + step_s).max(time_s);
                keys.push(key);
            }
            found += usize::from(self.tag.pose(time_s).is_some());
            Ok(())
        })?;
        if keys.len() < LEAST_KEYS {
            return Err(SceneError::TooFewFrames { found, n, needed: LEAST_KEYS }.into());
        }
        self.keys = keys;
        Ok(())
    }

    /// The grid that covers what the frames saw.
    fn grid(&self) -> Result<MapGrid, SceneError> {
        let camera = &self.optics.camera;
        let (right, bottom) =
            (usize::from(camera.size.width) - 1, usize::from(camera.size.height) - 1);
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        let mut pixel_mm = 0.0;
        for key in &self.keys {
            let Some(plane) = self.optics.head.plane_from_pi(&key.pose) else { continue };
            for (x, y) in [(0, 0), (right, 0), (0, bottom), (right, bottom)] {
                let [u, v] = camera.ray(x, y);
                let place = plane * Vector3::new(u, v, 1.0);
                for axis in 0..2 {
                    low[axis] = low[axis].min(place[axis] / place.z);
                    high[axis] = high[axis].max(place[axis] / place.z);
                }
            }
            pixel_mm += key.pose[2] / camera.lens.focal_px / self.keys.len() as f64;
        }
        let cell_mm = CELL_PX * pixel_mm;
        let side = |axis: usize| ((high[axis] - low[axis]) / cell_mm).ceil() + 5.0;
        let cells = side(0) * side(1);
        if !(cells > 0.0 && cells <= MAX_CELLS as f64) {
            return Err(SceneError::TooLarge { cells, limit: MAX_CELLS });
        }
        let origin_mm = low.map(|low| low - 2.0 * cell_mm);
        Ok(MapGrid { origin_mm, cell_mm, width: side(0) as usize, height: side(1) as usize })
    }

    /// Rounds of map and poses; the map with its errors, and the standard error of the row time.
    fn make_map(&mut self) -> Result<(RadianceMap, f64), SceneError> {
        self.optics.camera.balance(self.keys.iter().map(|key| key.samples.as_slice()));
        let grid = self.grid()?;
        let mut map = splat(grid, &self.optics, &self.keys, None);
        let mut row_error_s = f64::NAN;
        for _ in 0..ROUNDS {
            let ratios = site_ratios(&self.optics, &self.keys, &map);
            self.optics.camera.rebalance(ratios);
            row_error_s = self.improve(&map)?;
            self.drop_strange_light();
            map = splat(grid, &self.optics, &self.keys, Some(&map));
        }
        Ok((map, row_error_s))
    }

    /// One round: the shared constants once, poses and brightness with them.
    fn improve(&mut self, map: &RadianceMap) -> Result<f64, SceneError> {
        let white_dn = map.white_dn().ok_or(SceneError::NoTexture)?;
        self.noise.floor_dn = 0.02 * white_dn;
        let marks = map.marks(MARKS, white_dn);
        if marks.is_empty() {
            return Err(SceneError::NoTexture);
        }
        let reference = Reference { optics: &self.optics, map, marks: &marks, noise: self.noise };
        let equations: Vec<_> = self.keys.par_iter().map(|key| reference.all(key)).collect();
        let mut shared = self.prior();
        let mut parts = Vec::with_capacity(equations.len());
        let mut noise = Vec::new();
        for equations in &equations {
            let part = equations.as_ref().and_then(|e| split(&e.normal, &e.right));
            if let (Some(part), Some(e)) = (&part, equations) {
                shared.0 += part.normal;
                shared.1 += part.right;
                noise.push(e.squares / e.n.max(1) as f64);
            }
            parts.push(part);
        }
        let inverse = shared.0.try_inverse().ok_or(SceneError::NoFit("the head's geometry"))?;
        let mut change = inverse * shared.1;
        self.row_found_s = self.optics.row_s + change[SHARED - 1];
        // Against the world's truth the frames' row time came out up to 6 % long, together with a
        // tilt: only one that is far off is believed against what is stated.
        let is_near = (self.row_found_s / self.stated_row_s - 1.0).abs() < ROW_BELIEF;
        if is_near {
            change[SHARED - 1] = self.stated_row_s - self.optics.row_s;
        }
        let level = median(&mut noise).ok_or(SceneError::NoTexture)?;
        for (key, part) in self.keys.iter_mut().zip(&parts) {
            if let Some(part) = part {
                let own = part.own_right - part.own_shared * change;
                (0..4).for_each(|i| key.pose[i] += own[i]);
                key.ln_gain += own[4];
            }
        }
        let by = std::array::from_fn(|i| change[i]);
        self.optics.head = self.optics.head.moved(&by);
        self.optics.row_s += change[SHARED - 1];
        self.noise.variance_per_dn *= level;
        self.level_gains();
        self.renew_speeds();
        Ok((inverse[(SHARED - 1, SHARED - 1)] * level).max(0.0).sqrt())
    }

    /// What is known of the shared constants before.
    fn prior(&self) -> (SMatrix<f64, SHARED, SHARED>, SVector<f64, SHARED>) {
        let head = &self.optics.head;
        let row = (ROW_SHARE * self.stated_row_s).max(1e-7);
        let apart = [
            head.tilt_rad[0] / TILT_RAD,
            head.tilt_rad[1] / TILT_RAD,
            head.axis_tilt_rad[0] / TILT_RAD,
            head.axis_tilt_rad[1] / TILT_RAD,
            (self.optics.row_s - self.stated_row_s) / row,
        ];
        let sigma = [TILT_RAD, TILT_RAD, TILT_RAD, TILT_RAD, row];
        (
            SMatrix::from_fn(|i, j| if i == j { ALIKE * sigma[i].powi(-2) } else { 0.0 }),
            SVector::from_fn(|i, _| -ALIKE * apart[i] / sigma[i]),
        )
    }

    /// Takes the keys' speeds from their own path where they are close enough.
    fn renew_speeds(&mut self) {
        let knot = |key: &Key| PathKnot {
            time_s: self.optics.middle_s(key.first_s),
            pose: key.pose,
            pose_error: [0.0; 4],
            ln_gain: 0.0,
            misfit: 1.0,
        };
        let knots = self.keys.iter().map(knot).collect();
        let path = HeadPath::new(self.tag.zero(), knots, MAX_GAP);
        for key in &mut self.keys {
            let time_s = self.optics.middle_s(key.first_s);
            if path.pose(time_s + 1e-3).is_some() || path.pose(time_s - 1e-3).is_some() {
                key.speed = path.speed(time_s);
            }
        }
    }

    /// Frames in other light than most (a flash, whose edge cuts through the rows) tell little of the
    /// print and much that is wrong.
    fn drop_strange_light(&mut self) {
        let mut levels: Vec<f64> = self.keys.iter().map(|key| key.ln_gain).collect();
        let Some(usual) = median(&mut levels) else { return };
        let is_usual = |key: &Key| (key.ln_gain - usual).abs() < STRANGE_LIGHT;
        if self.keys.iter().filter(|key| is_usual(key)).count() >= LEAST_KEYS {
            self.keys.retain(is_usual);
        }
        self.level_gains();
    }

    /// Brightness is counted from the frames' mean: the map has the rest.
    fn level_gains(&mut self) {
        let mean = self.keys.iter().map(|key| key.ln_gain).sum::<f64>() / self.keys.len() as f64;
        self.keys.iter_mut().for_each(|key| key.ln_gain -= mean);
    }

    /// Puts every frame on the path.
    fn follow<F: Footage>(
        &self,
        footage: &mut F,
        map: &RadianceMap,
        white_dn: f64,
    ) -> Result<(HeadPath, [usize; 2]), F::Error> {
        let marks = map.marks(MARKS, white_dn);
        let reference = Reference { optics: &self.optics, map, marks: &marks, noise: self.noise };
        let mut knots: Vec<PathKnot> = Vec::new();
        let mut n_frames = [0; 2];
        footage.replay(&mut |index, frame| {
            n_frames[0] += 1;
            let start = self.key(index, frame)?;
            let later = |key: &Key| {
                let time_s = self.optics.middle_s(key.first_s);
                knots.last().is_none_or(|knot| knot.time_s < time_s)
            };
            let located = start.filter(later).and_then(|key| locate(&reference, key));
            match located {
                Some(knot) => knots.push(knot),
                None => n_frames[1] += 1,
            }
            Ok(())
        })?;
        Ok((HeadPath::new(self.tag.zero(), knots, MAX_GAP), n_frames))
    }
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
