//! Joint estimation of the map, the shared geometry and the poses.

use super::align::{ALL, Equations, Noise, Reference, SHARED};
use super::error::SceneError;
use super::fall_off::more_lost;
use super::follow::{Follower, Waiting};
use super::head::{HEAD, Head, HeadPose};
use super::locate::{Part, split};
use super::map::RadianceMap;
use super::mosaic::PiCamera;
use super::moving_light::{Found, Levels};
use super::path::{HeadPath, PathKnot};
use super::read_noise::read_noise;
use super::robust::clustered;
use super::splat::{Key, Optics, covering, site_ratios, splat};
use super::squares::Squares;
use super::start::TagPath;
use super::survey::{Footage, PiKnown};
use super::tag_rows::by_tag;
use super::tag_tilt::{Lie, apart};
use evrig_core::frame::Frame;
use evrig_core::stats::upper_median;
use evrig_core::time::{PiSensor, Span};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::sync::Arc;

/// Most frames from which the map is estimated.
const KEYS: usize = 150;

/// Fewest frames for a map.
const LEAST_KEYS: usize = 12;

/// Map features for the joint estimation, and for the pose of each frame. With more of them the
/// map's own error dominates.
const MARKS: usize = 24_000;
const PATH_MARKS: usize = 12_000;

/// Longest gap between frames that is interpolated.
const MAX_GAP: Span = Span::from_micros(50_000);

/// Greatest deviation of a keyframe's log brightness from the median.
const STRANGE_LIGHT: f64 = 0.03;

/// The tag's row time is used when its error is below this share of the nominal one. The estimate
/// from the map is a few percent too long.
const ROW_TOLD: f64 = 0.1;

/// Prior standard deviation of the row time, as a share of the nominal one.
const ROW_SHARE: f64 = 0.2;

/// The nominal row time is kept when the measured one differs by a smaller share.
const ROW_BELIEF: f64 = 0.15;

/// Greatest accepted vignetting.
const MOST_LOST: f64 = 0.9;

/// Index of the row time in the shared unknowns.
const ROW: usize = SHARED - 1;

/// Number of pixels with common errors: so many count as one against the prior. On one circle the
/// row time, a tilt and a changing distance are nearly collinear.
const ALIKE: f64 = 1_000.0;

fn believed(found_s: f64, stated_s: f64) -> f64 {
    if (found_s / stated_s - 1.0).abs() < ROW_BELIEF { stated_s } else { found_s }
}

pub(super) struct Surveyor<'a> {
    tag: TagPath<'a>,
    /// Tilts from the tag's perspective.
    lie: Lie,
    /// The path of a previous map.
    known: Option<HeadPath>,
    optics: Optics,
    stated_row_s: f64,
    /// Row time from the tag with its standard error; None where it is too uncertain.
    row_by_tag_s: Option<[f64; 2]>,
    /// Measured row time.
    row_found_s: f64,
    keys: Vec<Key>,
    noise: Noise,
}

/// A map and the parameters estimated with it.
pub(super) struct Made {
    pub(super) map: RadianceMap,
    pub(super) white_dn: f64,
    pub(super) row_error_s: f64,
    pub(super) corner_loss: Option<[f64; 2]>,
    pub(super) read_noise_dn: Option<[f64; 2]>,
}

/// Poses of all frames.
pub(super) struct Followed {
    pub(super) path: HeadPath,
    /// All frames, and those without a pose.
    pub(super) n_frames: [usize; 2],
    pub(super) n_bridged: usize,
    pub(super) moving: Option<Found>,
}

impl<'a> Surveyor<'a> {
    pub(super) fn new(known: &PiKnown<'a>) -> Result<Self, SceneError> {
        let none = SceneError::TooFewFrames { found: 0, n: 0, needed: LEAST_KEYS };
        let mut tag = TagPath::new(known.track, Head::stated(&known.mount)).ok_or(none)?;
        let lie = Lie::by(&tag);
        tag.head = lie.head;
        let camera = PiCamera::new(known.size, known.lens, known.raw);
        let stated_row_s = known.row_time.as_secs_f64();
        let is_told = |by_tag: &[f64; 2]| by_tag[1] < ROW_TOLD * stated_row_s;
        let row_by_tag_s = by_tag(known.track, stated_row_s).filter(is_told);
        let row_found_s = row_by_tag_s.map_or(stated_row_s, |[row_s, _]| row_s);
        let row_s = believed(row_found_s, stated_row_s);
        let optics = Optics { camera, head: tag.head, row_s };
        let noise = Noise { variance_per_dn: 1.0, floor_dn: 10.0 };
        Ok(Self {
            tag,
            lie,
            known: None,
            optics,
            stated_row_s,
            row_by_tag_s,
            row_found_s,
            keys: Vec::new(),
            noise,
        })
    }

    pub(super) fn head(&self) -> Head {
        self.optics.head
    }

    pub(super) fn site_gains(&self) -> [f64; 4] {
        self.optics.camera.gains()
    }

    pub(super) fn row_found_s(&self) -> f64 {
        self.row_found_s
    }

    /// Start poses come from this path where it is known, and from the tag elsewhere.
    pub(super) fn go_by(&mut self, path: HeadPath) {
        self.known = Some(path);
    }

    /// Start pose and its derivative, where known.
    fn start(&self, time_s: f64) -> Option<(HeadPose, HeadPose)> {
        let known = self.known.as_ref();
        let by_path = known.and_then(|path| Some((path.pose(time_s)?, path.speed(time_s))));
        by_path.or_else(|| self.tag.pose(time_s))
    }

    fn key(
        &self,
        index: usize,
        frame: &Frame<PiSensor>,
        (pose, speed): (HeadPose, HeadPose),
    ) -> Result<Key, SceneError> {
        let samples = Arc::new(self.optics.camera.samples(index, frame)?);
        let exposure_s = frame.timing.exposure.map_or(0.0, |[from, to]| (to - from).as_secs_f64());
        Ok(Key { samples, first_s: self.first_s(frame), exposure_s, pose, speed, ln_gain: 0.0 })
    }

    fn first_s(&self, frame: &Frame<PiSensor>) -> f64 {
        (frame.timing.mid_exposure(0) - self.tag.zero()).as_secs_f64()
    }

    /// Selects keyframes at equal steps of time.
    pub(super) fn take_keys<F: Footage>(&mut self, footage: &mut F) -> Result<(), F::Error> {
        let by_path = self.known.as_ref().and_then(HeadPath::span_s);
        let [from, to] = by_path.unwrap_or_else(|| self.tag.span_s());
        let step_s = ((to - from) / KEYS as f64).max(1e-6);
        let mut next_s = from;
        let (mut n, mut found) = (0, 0);
        let mut keys = Vec::new();
        footage.replay(&mut |index, frame| {
            n += 1;
            let time_s = self.optics.middle_s(self.first_s(frame));
            let start = self.start(time_s);
            found += usize::from(start.is_some());
            if let Some(start) = start.filter(|_| time_s >= next_s) {
                next_s = (next_s + step_s).max(time_s);
                keys.push(self.key(index, frame, start)?);
            }
            Ok(())
        })?;
        if keys.len() < LEAST_KEYS {
            return Err(SceneError::TooFewFrames { found, n, needed: LEAST_KEYS }.into());
        }
        self.keys = keys;
        Ok(())
    }

    /// Alternates between the map and the poses.
    pub(super) fn make_map(&mut self, n_rounds: usize) -> Result<Made, SceneError> {
        self.optics.camera.balance(self.keys.iter().map(|key| key.samples.as_slice()));
        let grid = covering(&self.optics, &self.keys)?;
        let mut map = splat(grid, &self.optics, &self.keys, None);
        let (mut row_error_s, mut corner_loss) = (f64::NAN, None);
        for _ in 0..n_rounds {
            let ratios = site_ratios(&self.optics, &self.keys, &map);
            self.optics.camera.rebalance(ratios);
            if let Some([more, error]) = more_lost(&self.optics, &self.keys, &map) {
                let loss = (self.optics.camera.corner_loss() + more).clamp(0.0, MOST_LOST);
                self.optics.camera.set_corner_loss(loss);
                corner_loss = Some([loss, error]);
            }
            row_error_s = self.improve(&map)?;
            self.drop_strange_light();
            map = splat(grid, &self.optics, &self.keys, Some(&map));
        }
        let white_dn = map.white_dn().ok_or(SceneError::NoTexture)?;
        let read_noise_dn = read_noise(&self.optics, &map, &self.keys);
        Ok(Made { map, white_dn, row_error_s, corner_loss, read_noise_dn })
    }

    /// One Gauss-Newton step of all unknowns; returns the standard error of the row time.
    fn improve(&mut self, map: &RadianceMap) -> Result<f64, SceneError> {
        let white_dn = map.white_dn().ok_or(SceneError::NoTexture)?;
        self.noise.floor_dn = 0.02 * white_dn;
        let marks = map.marks(MARKS, white_dn);
        if marks.is_empty() {
            return Err(SceneError::NoTexture);
        }
        let reference = Reference { optics: &self.optics, map, marks: &marks, noise: self.noise };
        let equations: Vec<_> = self.keys.par_iter().map(|key| reference.all(key)).collect();
        let part = |e: &Option<Equations<ALL>>| e.as_ref().and_then(|e| split(&e.normal, &e.right));
        let parts: Vec<Option<Part>> = equations.iter().map(part).collect();
        let usable = equations.iter().flatten().filter(|e| e.n > 0);
        let mut noise: Vec<f64> = usable.map(|e| e.squares / e.n as f64).collect();
        let level = upper_median(&mut noise).ok_or(SceneError::NoTexture)?;
        let (change, row_error_s) = self.shared_change(&parts, level)?;
        for (key, part) in self.keys.iter_mut().zip(&parts) {
            if let Some(part) = part {
                let own = part.own_right - part.own_shared * change;
                (0..4).for_each(|i| key.pose[i] += own[i]);
                key.ln_gain += own[4];
            }
        }
        let by = std::array::from_fn(|i| change[i]);
        self.optics.head = self.optics.head.moved(&by);
        self.optics.row_s += change[ROW];
        self.noise.variance_per_dn *= level;
        let reference = Reference { optics: &self.optics, map, marks: &marks, noise: self.noise };
        self.keys.par_iter_mut().for_each(|key| {
            key.ln_gain = reference.ln_level(key).unwrap_or(key.ln_gain);
        });
        self.level_gains();
        self.renew_speeds();
        Ok(row_error_s)
    }

    /// Step of the shared constants, and the standard error of the row time.
    fn shared_change(
        &mut self,
        parts: &[Option<Part>],
        level: f64,
    ) -> Result<(SVector<f64, SHARED>, f64), SceneError> {
        let no_fit = SceneError::NoFit("the head's geometry");
        let (mut normal, mut right) = self.prior();
        for part in parts.iter().flatten() {
            normal += part.normal;
            right += part.right;
        }
        let row_error_s = match self.row_by_tag_s {
            Some([_, error_s]) => error_s,
            None => {
                let inverse = normal.try_inverse().ok_or_else(|| no_fit.clone())?;
                let change = inverse * right;
                self.row_found_s = self.optics.row_s + change[ROW];
                let parts = parts.iter().flatten();
                let scores: Vec<_> = parts.map(|p| p.right - p.normal * change).collect();
                // Errors common to all frames, from poses the map was made of, are not in their
                // spread.
                let alike = ALIKE * level * inverse[(ROW, ROW)];
                clustered(&inverse, &scores)[(ROW, ROW)].max(alike).max(0.0).sqrt()
            }
        };
        // On a circle in one direction the row time and a tilt are nearly collinear, so the others
        // are estimated given the accepted row time.
        let row = believed(self.row_found_s, self.stated_row_s) - self.optics.row_s;
        right -= normal.column(ROW) * row;
        normal.row_mut(ROW).fill(0.0);
        normal.column_mut(ROW).fill(0.0);
        (normal[(ROW, ROW)], right[ROW]) = (1.0, row);
        let inverse = normal.try_inverse().ok_or(no_fit)?;
        Ok((inverse * right, row_error_s))
    }

    /// Prior of the shared constants: the tilts from the tag, the nominal row time.
    fn prior(&self) -> (SMatrix<f64, SHARED, SHARED>, SVector<f64, SHARED>) {
        let error_s = (ROW_SHARE * self.stated_row_s).max(1e-7);
        let tilts = self.lie.information * -apart(&self.optics.head, &self.lie.head);
        let mut normal = SMatrix::<f64, SHARED, SHARED>::zeros();
        let mut right = SVector::<f64, SHARED>::zeros();
        normal.fixed_view_mut::<HEAD, HEAD>(0, 0).copy_from(&self.lie.information);
        right.fixed_rows_mut::<HEAD>(0).copy_from(&tilts);
        normal[(ROW, ROW)] = error_s.powi(-2);
        right[ROW] = (self.stated_row_s - self.optics.row_s) / error_s.powi(2);
        (normal * ALIKE, right * ALIKE)
    }

    /// Derivatives of the keyframes' poses from the path through them, where it is dense enough.
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

    /// Drops keyframes of unusual brightness: the edge of a flash within the rows biases the map.
    fn drop_strange_light(&mut self) {
        let mut levels: Vec<f64> = self.keys.iter().map(|key| key.ln_gain).collect();
        let Some(usual) = upper_median(&mut levels) else { return };
        let is_usual = |key: &Key| (key.ln_gain - usual).abs() < STRANGE_LIGHT;
        if self.keys.iter().filter(|key| is_usual(key)).count() >= LEAST_KEYS {
            self.keys.retain(is_usual);
        }
        self.level_gains();
    }

    /// Centres the log gains; their mean belongs to the map.
    fn level_gains(&mut self) {
        let mean = self.keys.iter().map(|key| key.ln_gain).sum::<f64>() / self.keys.len() as f64;
        self.keys.iter_mut().for_each(|key| key.ln_gain -= mean);
    }

    /// Estimates the pose of every frame.
    pub(super) fn follow<F: Footage>(
        &self,
        footage: &mut F,
        made: &Made,
    ) -> Result<Followed, F::Error> {
        let marks = made.map.marks(PATH_MARKS, made.white_dn);
        let reference =
            Reference { optics: &self.optics, map: &made.map, marks: &marks, noise: self.noise };
        let mut follower = Follower::new(&reference);
        let mut n = 0;
        footage.replay(&mut |index, frame| {
            n += 1;
            let time_s = self.optics.middle_s(self.first_s(frame));
            if follower.is_later(time_s) {
                let start = self.start(time_s);
                let key = self.key(index, frame, start.unwrap_or_default())?;
                let has_tag = self.tag.pose(time_s).is_some();
                follower.take(Waiting { key, time_s, has_start: start.is_some(), has_tag });
            }
            Ok(())
        })?;
        let (located, n_bridged) = follower.finish();
        let squares = Squares::covering(&made.map.grid);
        let seen = located.iter().map(|found| (&found.knot, found.levels.as_slice()));
        let moving = Levels::new(squares, seen).moving();
        let mut knots: Vec<PathKnot> = located.iter().map(|found| found.knot).collect();
        if let Some(moving) = &moving {
            let lamps = knots.iter_mut().zip(&moving.ln_lamps);
            lamps.for_each(|(knot, ln_lamps)| knot.ln_gain = *ln_lamps);
        }
        let n_frames = [n, n - knots.len()];
        let path = HeadPath::new(self.tag.zero(), knots, MAX_GAP);
        Ok(Followed { path, n_frames, n_bridged, moving })
    }
}
