//! Joint estimation of the map, the shared geometry and the poses.

use super::accumulate::{Keyframe, MapOptics, accumulate, grid_covering, site_ratios};
use super::clustered_covariance::clustered_covariance;
use super::coarse_grid::CoarseGrid;
use super::error::SceneError;
use super::head::{HEAD_DOF, HeadGeometry, HeadPose};
use super::locate::{ReducedEquations, eliminate_pose};
use super::map::RadianceMap;
use super::moving_illumination::{CellRatios, IlluminationFit};
use super::path::{HeadPath, PathKnot};
use super::photometric::{
    ALL_UNKNOWNS, FrameEquations, MapReference, PhotometricNoise, SHARED_UNKNOWNS,
};
use super::pi_camera::PiCamera;
use super::pi_inputs::{PiInputs, RawFrames};
use super::pose_tracking::{PendingFrame, PoseTracker};
use super::read_noise::read_noise;
use super::tag_pose::TagPath;
use super::tag_row_time::row_time_by_tag;
use super::tag_tilt::{TagTilt, tilt_difference};
use super::vignetting::corner_loss_update;
use evrig_core::frame::Frame;
use evrig_core::stats::upper_median;
use evrig_core::time::{PiSensor, Span};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::sync::Arc;

/// Most frames from which the map is estimated.
const MAX_KEYFRAMES: usize = 150;
/// Fewest frames for a map.
const MIN_KEYFRAMES: usize = 12;
/// Map features for the joint estimation, and for the pose of each frame. With more of them the
/// map's own error dominates.
const MAP_FEATURES: usize = 24_000;
const POSE_FEATURES: usize = 12_000;
/// Longest gap between frames that is interpolated.
const MAX_GAP: Span = Span::from_micros(50_000);
/// Greatest deviation of a keyframe's log brightness from the median.
const MAX_LOG_GAIN_DEVIATION: f64 = 0.03;
/// The tag's row time is used when its error is below this share of the nominal one. The estimate
/// from the map is a few percent too long.
const MAX_TAG_ROW_ERROR: f64 = 0.1;
/// Prior standard deviation of the row time, as a share of the nominal one.
const ROW_PRIOR_SHARE: f64 = 0.2;
/// The nominal row time is kept when the measured one differs by a smaller share.
const ROW_TOLERANCE: f64 = 0.15;
/// Greatest accepted vignetting.
const MAX_CORNER_LOSS: f64 = 0.9;
/// Index of the row time in the shared unknowns.
const ROW_TIME: usize = SHARED_UNKNOWNS - 1;
/// Number of pixels with common errors: so many count as one against the prior. On one circle the
/// row time, a tilt and a changing distance are nearly collinear.
const CORRELATED_PIXELS: f64 = 1_000.0;

fn accepted_row_time(found_s: f64, stated_s: f64) -> f64 {
    if (found_s / stated_s - 1.0).abs() < ROW_TOLERANCE { stated_s } else { found_s }
}

pub(super) struct MapBuilder<'a> {
    tag: TagPath<'a>,
    tilts: TagTilt,
    /// Start poses come from this path where it is known, and from the tag elsewhere.
    pub(super) previous_path: Option<HeadPath>,
    pub(super) optics: MapOptics,
    stated_row_s: f64,
    /// Row time from the tag with its standard error; None where it is too uncertain.
    row_by_tag_s: Option<[f64; 2]>,
    pub(super) measured_row_s: f64,
    keyframes: Vec<Keyframe>,
    noise: PhotometricNoise,
}

pub(super) struct BuiltMap {
    pub(super) map: RadianceMap,
    pub(super) white_dn: f64,
    pub(super) row_error_s: f64,
    pub(super) corner_loss: Option<[f64; 2]>,
    pub(super) read_noise_dn: Option<[f64; 2]>,
}

pub(super) struct FramePoses {
    pub(super) path: HeadPath,
    /// All frames, and those without a pose.
    pub(super) n_frames: [usize; 2],
    pub(super) n_bridged: usize,
    pub(super) illumination: Option<IlluminationFit>,
}

impl<'a> MapBuilder<'a> {
    pub(super) fn new(inputs: &PiInputs<'a>) -> Result<Self, SceneError> {
        let none = SceneError::TooFewFrames { found: 0, n: 0, needed: MIN_KEYFRAMES };
        let mut tag =
            TagPath::new(inputs.track, HeadGeometry::stated(&inputs.mount)).ok_or(none)?;
        let tilts = TagTilt::by(&tag);
        tag.head = tilts.head;
        let camera = PiCamera::new(inputs.size, inputs.lens, inputs.raw);
        let stated_row_s = inputs.row_time.as_secs_f64();
        let is_precise = |[_, error_s]: &[f64; 2]| *error_s < MAX_TAG_ROW_ERROR * stated_row_s;
        let row_by_tag_s = row_time_by_tag(inputs.track, stated_row_s).filter(is_precise);
        let measured_row_s = row_by_tag_s.map_or(stated_row_s, |[row_s, _]| row_s);
        let row_s = accepted_row_time(measured_row_s, stated_row_s);
        let optics = MapOptics { camera, head: tag.head, row_s };
        let noise = PhotometricNoise { variance_per_dn: 1.0, floor_dn: 10.0 };
        Ok(Self {
            tag,
            tilts,
            previous_path: None,
            optics,
            stated_row_s,
            row_by_tag_s,
            measured_row_s,
            keyframes: Vec::new(),
            noise,
        })
    }

    /// Start pose and its derivative, where known.
    fn start(&self, time_s: f64) -> Option<(HeadPose, HeadPose)> {
        let previous = self.previous_path.as_ref();
        let by_path = previous.and_then(|path| Some((path.pose(time_s)?, path.speed(time_s))));
        by_path.or_else(|| self.tag.pose(time_s))
    }

    fn key(
        &self,
        index: usize,
        frame: &Frame<PiSensor>,
        (pose, speed): (HeadPose, HeadPose),
    ) -> Result<Keyframe, SceneError> {
        let samples = Arc::new(self.optics.camera.samples(index, frame)?);
        let exposure_s = frame.timing.exposure.map_or(0.0, |[from, to]| (to - from).as_secs_f64());
        Ok(Keyframe {
            samples,
            first_s: self.first_s(frame),
            exposure_s,
            pose,
            speed,
            ln_gain: 0.0,
        })
    }

    fn first_s(&self, frame: &Frame<PiSensor>) -> f64 {
        (frame.timing.mid_exposure(0) - self.tag.zero).as_secs_f64()
    }

    /// Selects keyframes at equal steps of time.
    pub(super) fn select_keyframes<F: RawFrames>(
        &mut self,
        source: &mut F,
    ) -> Result<(), F::Error> {
        let by_path = self.previous_path.as_ref().and_then(HeadPath::span_s);
        let [from, to] = by_path.unwrap_or_else(|| self.tag.span_s());
        let step_s = ((to - from) / MAX_KEYFRAMES as f64).max(1e-6);
        let mut next_s = from;
        let (mut n, mut found) = (0, 0);
        let mut keyframes = Vec::new();
        source.replay(&mut |index, frame| {
            n += 1;
            let time_s = self.optics.middle_s(self.first_s(frame));
            let start = self.start(time_s);
            found += usize::from(start.is_some());
            if let Some(start) = start.filter(|_| time_s >= next_s) {
                next_s = (next_s + step_s).max(time_s);
                keyframes.push(self.key(index, frame, start)?);
            }
            Ok(())
        })?;
        if keyframes.len() < MIN_KEYFRAMES {
            return Err(SceneError::TooFewFrames { found, n, needed: MIN_KEYFRAMES }.into());
        }
        self.keyframes = keyframes;
        Ok(())
    }

    pub(super) fn build_map(&mut self, n_rounds: usize) -> Result<BuiltMap, SceneError> {
        self.optics.camera.balance(self.keyframes.iter().map(|key| key.samples.as_slice()));
        let grid = grid_covering(&self.optics, &self.keyframes)?;
        let mut map = accumulate(grid, &self.optics, &self.keyframes, None);
        let (mut row_error_s, mut corner_loss) = (f64::NAN, None);
        for _ in 0..n_rounds {
            let ratios = site_ratios(&self.optics, &self.keyframes, &map);
            self.optics.camera.rebalance(ratios);
            if let Some([more, error]) = corner_loss_update(&self.optics, &self.keyframes, &map) {
                let loss = (self.optics.camera.corner_loss() + more).clamp(0.0, MAX_CORNER_LOSS);
                self.optics.camera.set_corner_loss(loss);
                corner_loss = Some([loss, error]);
            }
            row_error_s = self.gauss_newton_step(&map)?;
            self.drop_brightness_outliers();
            map = accumulate(grid, &self.optics, &self.keyframes, Some(&map));
        }
        let white_dn = map.white_dn().ok_or(SceneError::NoTexture)?;
        let read_noise_dn = read_noise(&self.optics, &map, &self.keyframes);
        Ok(BuiltMap { map, white_dn, row_error_s, corner_loss, read_noise_dn })
    }

    /// One Gauss-Newton step of all unknowns; returns the standard error of the row time.
    fn gauss_newton_step(&mut self, map: &RadianceMap) -> Result<f64, SceneError> {
        let white_dn = map.white_dn().ok_or(SceneError::NoTexture)?;
        self.noise.floor_dn = 0.02 * white_dn;
        let features = map.features(MAP_FEATURES, white_dn);
        if features.is_empty() {
            return Err(SceneError::NoTexture);
        }
        let reference =
            MapReference { optics: &self.optics, map, features: &features, noise: self.noise };
        let equations: Vec<_> =
            self.keyframes.par_iter().map(|key| reference.joint_equations(key)).collect();
        let part = |e: &Option<FrameEquations<ALL_UNKNOWNS>>| {
            e.as_ref().and_then(|e| eliminate_pose(&e.normal, &e.right))
        };
        let parts: Vec<Option<ReducedEquations>> = equations.iter().map(part).collect();
        let usable = equations.iter().flatten().filter(|e| e.n > 0);
        let mut noise: Vec<f64> = usable.map(|e| e.weighted_squares / e.n as f64).collect();
        let level = upper_median(&mut noise).ok_or(SceneError::NoTexture)?;
        let (change, row_error_s) = self.shared_change(&parts, level)?;
        for (key, part) in self.keyframes.iter_mut().zip(&parts) {
            if let Some(part) = part {
                let own = part.own_right - part.own_shared * change;
                (0..4).for_each(|i| key.pose[i] += own[i]);
                key.ln_gain += own[4];
            }
        }
        let by = std::array::from_fn(|i| change[i]);
        self.optics.head = self.optics.head.moved(&by);
        self.optics.row_s += change[ROW_TIME];
        self.noise.variance_per_dn *= level;
        let reference =
            MapReference { optics: &self.optics, map, features: &features, noise: self.noise };
        self.keyframes.par_iter_mut().for_each(|key| {
            key.ln_gain = reference.ln_level(key).unwrap_or(key.ln_gain);
        });
        self.level_gains();
        self.renew_speeds();
        Ok(row_error_s)
    }

    /// Step of the shared constants, and the standard error of the row time.
    fn shared_change(
        &mut self,
        parts: &[Option<ReducedEquations>],
        level: f64,
    ) -> Result<(SVector<f64, SHARED_UNKNOWNS>, f64), SceneError> {
        let no_fit = SceneError::NoFit("the geometry of the head");
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
                self.measured_row_s = self.optics.row_s + change[ROW_TIME];
                let parts = parts.iter().flatten();
                let scores: Vec<_> = parts.map(|p| p.right - p.normal * change).collect();
                // Errors common to all frames, from poses the map was made of, are not in their
                // spread.
                let common = CORRELATED_PIXELS * level * inverse[(ROW_TIME, ROW_TIME)];
                clustered_covariance(&inverse, &scores)[(ROW_TIME, ROW_TIME)]
                    .max(common)
                    .max(0.0)
                    .sqrt()
            }
        };
        // On a circle in one direction the row time and a tilt are nearly collinear, so the others
        // are estimated given the accepted row time.
        let row = accepted_row_time(self.measured_row_s, self.stated_row_s) - self.optics.row_s;
        right -= normal.column(ROW_TIME) * row;
        normal.row_mut(ROW_TIME).fill(0.0);
        normal.column_mut(ROW_TIME).fill(0.0);
        (normal[(ROW_TIME, ROW_TIME)], right[ROW_TIME]) = (1.0, row);
        let inverse = normal.try_inverse().ok_or(no_fit)?;
        Ok((inverse * right, row_error_s))
    }

    /// Prior of the shared constants: the tilts from the tag, the nominal row time.
    fn prior(
        &self,
    ) -> (SMatrix<f64, SHARED_UNKNOWNS, SHARED_UNKNOWNS>, SVector<f64, SHARED_UNKNOWNS>) {
        let error_s = (ROW_PRIOR_SHARE * self.stated_row_s).max(1e-7);
        let tilts = self.tilts.information * -tilt_difference(&self.optics.head, &self.tilts.head);
        let mut normal = SMatrix::<f64, SHARED_UNKNOWNS, SHARED_UNKNOWNS>::zeros();
        let mut right = SVector::<f64, SHARED_UNKNOWNS>::zeros();
        normal.fixed_view_mut::<HEAD_DOF, HEAD_DOF>(0, 0).copy_from(&self.tilts.information);
        right.fixed_rows_mut::<HEAD_DOF>(0).copy_from(&tilts);
        normal[(ROW_TIME, ROW_TIME)] = error_s.powi(-2);
        right[ROW_TIME] = (self.stated_row_s - self.optics.row_s) / error_s.powi(2);
        (normal * CORRELATED_PIXELS, right * CORRELATED_PIXELS)
    }

    /// Derivatives of the keyframes' poses from the path through them, where it is dense enough.
    fn renew_speeds(&mut self) {
        let knot = |key: &Keyframe| PathKnot {
            time_s: self.optics.middle_s(key.first_s),
            pose: key.pose,
            pose_error: [0.0; 4],
            ln_gain: 0.0,
            misfit: 1.0,
        };
        let knots = self.keyframes.iter().map(knot).collect();
        let path = HeadPath::new(self.tag.zero, knots, MAX_GAP);
        for key in &mut self.keyframes {
            let time_s = self.optics.middle_s(key.first_s);
            if path.pose(time_s + 1e-3).is_some() || path.pose(time_s - 1e-3).is_some() {
                key.speed = path.speed(time_s);
            }
        }
    }

    /// Drops keyframes of unusual brightness: the edge of a flash within the rows biases the map.
    fn drop_brightness_outliers(&mut self) {
        let mut levels: Vec<f64> = self.keyframes.iter().map(|key| key.ln_gain).collect();
        let Some(usual) = upper_median(&mut levels) else { return };
        let is_usual = |key: &Keyframe| (key.ln_gain - usual).abs() < MAX_LOG_GAIN_DEVIATION;
        if self.keyframes.iter().filter(|key| is_usual(key)).count() >= MIN_KEYFRAMES {
            self.keyframes.retain(is_usual);
        }
        self.level_gains();
    }

    /// Centres the log gains; their mean belongs to the map.
    fn level_gains(&mut self) {
        let mean =
            self.keyframes.iter().map(|key| key.ln_gain).sum::<f64>() / self.keyframes.len() as f64;
        self.keyframes.iter_mut().for_each(|key| key.ln_gain -= mean);
    }

    pub(super) fn locate_frames<F: RawFrames>(
        &self,
        source: &mut F,
        built: &BuiltMap,
    ) -> Result<FramePoses, F::Error> {
        let features = built.map.features(POSE_FEATURES, built.white_dn);
        let reference = MapReference {
            optics: &self.optics,
            map: &built.map,
            features: &features,
            noise: self.noise,
        };
        let mut tracker = PoseTracker::new(&reference);
        let mut n = 0;
        source.replay(&mut |index, frame| {
            n += 1;
            let time_s = self.optics.middle_s(self.first_s(frame));
            if tracker.is_later(time_s) {
                let start = self.start(time_s);
                let key = self.key(index, frame, start.unwrap_or_default())?;
                let has_tag = self.tag.pose(time_s).is_some();
                tracker.push(PendingFrame { key, time_s, has_start: start.is_some(), has_tag });
            }
            Ok(())
        })?;
        let (located, n_bridged) = tracker.finish();
        let grid = CoarseGrid::covering(&built.map.grid);
        let levels = located.iter().map(|found| (&found.knot, found.levels.as_slice()));
        let illumination = CellRatios::new(grid, levels).fit();
        let mut knots: Vec<PathKnot> = located.iter().map(|found| found.knot).collect();
        if let Some(illumination) = &illumination {
            let lamps = knots.iter_mut().zip(&illumination.ln_lamps);
            lamps.for_each(|(knot, ln_lamps)| knot.ln_gain = *ln_lamps);
        }
        let n_frames = [n, n - knots.len()];
        let path = HeadPath::new(self.tag.zero, knots, MAX_GAP);
        Ok(FramePoses { path, n_frames, n_bridged, illumination })
    }
}
