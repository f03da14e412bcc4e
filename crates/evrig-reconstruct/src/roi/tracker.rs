//! Tracker of one tag through the frames of one camera.

use super::corner_fit::{FittedCorners, fit_corners};
use super::detection::{LossReason, TagDetection, TrackTally};
use super::grey_image::{GreyImage, SampleFormat};
use super::lens::Lens;
use super::observe::{detection, observe};
use super::path_fit::{FittedPath, PathFitter};
use super::path_state::PathChart;
use super::tag_detector::{FAMILIES, TagDetector, TagSearch};
use super::target::TargetPlane;
use super::track::{LostFrame, Track, TrackGap, TrackKnot, TrackQuality};
use super::track_error::TrackError;
use evrig_core::frame::Frame;
use evrig_core::time::{Clock, Span, Stamp};
use evrig_core::units::Pixels;
use evrig_session::rig::{CameraDescription, TargetDescription};
use nalgebra::SVector;
use std::collections::BTreeMap;

/// Options of a tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackOptions {
    /// Meaning of the frames' samples.
    pub format: SampleFormat,
    /// Longest gap between detections that is interpolated.
    pub max_gap: Span,
    /// Least distance of a corner from the frame's border; a cut-off surrounding biases the outline
    /// fit.
    pub border: Pixels,
}

impl TrackOptions {
    /// Defaults: gaps of at most 150 ms, corners at least 6 px from the border.
    #[must_use]
    pub fn new(format: SampleFormat) -> Self {
        Self { format, max_gap: Span::from_micros(150_000), border: Pixels(6.0) }
    }
}

/// Tracks one tag through the frames of one camera.
pub struct Tracker<C: Clock> {
    detector: TagDetector,
    target: TargetDescription,
    plane: TargetPlane,
    lens: Lens,
    options: TrackOptions,
    decimation: f32,
    tally: TrackTally,
    losses: Vec<LostFrame<C>>,
    detections: Vec<TagDetection<C>>,
    last_time: Option<Stamp<C>>,
    /// Ids of other tags of the family, and of tags of other families, with counts of frames.
    others: BTreeMap<(String, usize), u64>,
    /// Frames in which other families were searched.
    n_family_searches: u64,
}

/// Most frames in which other families are searched, while nothing was detected.
const MAX_FAMILY_SEARCHES: u64 = 8;
/// Least width of a tag that is searched at half resolution: faster, with the same detection rate
/// (C detector: 40 px at blur 1 px).
const WIDE_TAG_PX: f64 = 40.0;
/// Least contrast of a frame, as a share of the full range.
const MIN_CONTRAST: f32 = 0.02;

impl<C: Clock> Tracker<C> {
    /// A tracker for the rig's tag in one of its cameras.
    ///
    /// # Errors
    /// When the rig's numbers are invalid or its tag family is unknown.
    pub fn new(
        target: &TargetDescription,
        camera: &CameraDescription,
        options: TrackOptions,
    ) -> Result<Self, TrackError> {
        let unknown = || TrackError::UnknownFamily(target.tag_family.clone());
        let detector = TagDetector::new(&target.tag_family, target.tag_id).ok_or_else(unknown)?;
        let (plane, lens) = (TargetPlane::of(target), Lens::of(camera));
        let needed = [
            ("tag_side_mm", plane.tag_side_mm),
            ("picture_side_mm", plane.picture_side_mm),
            ("a focal length in pixels", lens.focal_px),
        ];
        for (name, value) in needed {
            if !(value > 0.0 && value.is_finite()) {
                return Err(TrackError::BadRig { what: format!("{name} = {value}") });
            }
        }
        let scale = if matches!(options.format, SampleFormat::Mosaic { .. }) { 2.0 } else { 1.0 };
        let side = plane.tag_side_mm * camera.pixels_per_mm(target.stand_off) / scale;
        Ok(Self {
            detector,
            target: target.clone(),
            plane,
            lens,
            options,
            decimation: if side >= WIDE_TAG_PX { 2.0 } else { 1.0 },
            tally: TrackTally::default(),
            losses: Vec::new(),
            detections: Vec::new(),
            last_time: None,
            others: BTreeMap::new(),
            n_family_searches: 0,
        })
    }

    /// Detects the tag in the next frame. A detection may still be rejected as an outlier in
    /// [`Self::finish`].
    ///
    /// The frame's `timing.row_time` gives the exposure time of each row.
    ///
    /// # Errors
    /// The reason when the frame has no usable detection; it is counted, and the next frame may
    /// follow.
    pub fn see(&mut self, frame: &Frame<C>) -> Result<&TagDetection<C>, LossReason> {
        let number = self.tally.seen;
        self.tally.seen += 1;
        let time = frame.timing.mid_exposure(0);
        let seen = self.sight(frame, number, time);
        self.last_time = self.last_time.max(Some(time));
        match seen {
            Ok(detection) => {
                self.tally.used += 1;
                self.detections.push(detection);
                self.detections.last().ok_or(LossReason::NotFound)
            }
            Err(reason) => {
                self.tally.lose(reason);
                self.losses.push(LostFrame { frame: number, time, reason });
                Err(reason)
            }
        }
    }

    fn sight(
        &mut self,
        frame: &Frame<C>,
        number: u64,
        time: Stamp<C>,
    ) -> Result<TagDetection<C>, LossReason> {
        if self.last_time.is_some_and(|last| time <= last) {
            return Err(LossReason::OutOfOrder);
        }
        let grey =
            GreyImage::to_search(frame, self.options.format).ok_or(LossReason::Unreadable)?;
        let search = self.find(&grey, time);
        let Some(guess) = search.corners else { return Err(self.explain(frame, &grey, &search)) };
        let size = [frame.size.width, frame.size.height].map(f64::from);
        let border = self.options.border.0;
        let is_clear = |corner: &[f64; 2]| {
            (0..2).all(|axis| (border..=size[axis] - border).contains(&corner[axis]))
        };
        if !guess.iter().all(is_clear) {
            return Err(LossReason::AtBorder);
        }
        let corners = self.corners(frame, &grey, guess).ok_or(LossReason::Unclear)?;
        Ok(detection(frame, number, &corners))
    }

    /// Searches the predicted window, then the whole frame.
    fn find(&mut self, grey: &GreyImage, time: Stamp<C>) -> TagSearch {
        if let Some((expected, margin)) = self.expected(time)
            && let Some(window) = grey.window(&expected, margin)
        {
            self.tally.searched.windows += 1;
            self.tally.searched.window_pixels += window.n_pixels() as u64;
            let search = self.detector.search(grey, window, self.decimation);
            if search.corners.is_some() {
                return search;
            }
        }
        self.tally.searched.whole_frames += 1;
        self.detector.search(grey, grey.whole(), self.decimation)
    }

    /// Predicted corners and the margin of the search window, from the last two detections; None
    /// when those are too old.
    fn expected(&self, time: Stamp<C>) -> Option<([[f64; 2]; 4], f64)> {
        let last = self.detections.last()?;
        let since = (time - last.time).as_secs_f64();
        if time - last.time > self.options.max_gap {
            return None;
        }
        let side = distance(last.corners_px[0], last.corners_px[1])
            .max(distance(last.corners_px[1], last.corners_px[2]));
        // The tag's white margin of a cell and a half, and the change of its speed.
        let quiet = 0.2 * side + 4.0;
        let before = self.detections.len().checked_sub(2).map(|i| &self.detections[i]);
        let Some(before) = before.filter(|b| last.time - b.time < self.options.max_gap) else {
            return Some((last.corners_px, quiet + 0.5 * side));
        };
        let steps = since / (last.time - before.time).as_secs_f64();
        let mut moved = 0.0_f64;
        let mut expected = last.corners_px;
        for (corner, earlier) in expected.iter_mut().zip(before.corners_px) {
            let step = [corner[0] - earlier[0], corner[1] - earlier[1]];
            moved = moved.max(step[0].hypot(step[1]) * steps);
            *corner = [corner[0] + steps * step[0], corner[1] + steps * step[1]];
        }
        Some((expected, quiet + 2.0 + 0.5 * moved))
    }

    fn corners(
        &self,
        frame: &Frame<C>,
        grey: &GreyImage,
        guess: [[f64; 2]; 4],
    ) -> Option<FittedCorners> {
        let SampleFormat::Mosaic { black_level_dn } = self.options.format else {
            return fit_corners(grey, guess);
        };
        // Half resolution first: the fit needs a start within half a cell.
        let coarse = fit_corners(grey, guess).map_or(guess, |corners| corners.points);
        let full = GreyImage {
            width: usize::from(frame.size.width),
            height: usize::from(frame.size.height),
            values: Vec::new(),
            scale: 1,
        };
        let side = distance(coarse[0], coarse[1]);
        let window = full.window(&coarse, 0.15 * side + 2.0)?;
        fit_corners(&GreyImage::balanced(frame, black_level_dn, window), coarse)
    }

    fn explain(&mut self, frame: &Frame<C>, grey: &GreyImage, search: &TagSearch) -> LossReason {
        let full = match frame.samples.bits() {
            8 => 255.0,
            // Ten bits, unless the samples exceed them.
            _ => grey.values.iter().fold(1023.0_f32, |high, value| high.max(*value)),
        };
        if grey.contrast() < MIN_CONTRAST * full {
            return LossReason::NoContrast;
        }
        if search.n_places > 1 {
            return LossReason::Repeated;
        }
        for &id in &search.others {
            *self.others.entry((self.target.tag_family.clone(), id)).or_default() += 1;
        }
        if search.others.is_empty()
            && self.detections.is_empty()
            && self.n_family_searches < MAX_FAMILY_SEARCHES
        {
            self.n_family_searches += 1;
            let mirrored = grey.mirrored();
            if self.detector.search(&mirrored, grey.whole(), self.decimation).n_places > 0 {
                return LossReason::Mirrored;
            }
            self.search_other_families(grey);
        }
        if search.others.is_empty() { LossReason::NotFound } else { LossReason::OtherId }
    }

    /// Counts the tags of other families, of any id.
    fn search_other_families(&mut self, grey: &GreyImage) {
        for family in FAMILIES.iter().filter(|family| **family != self.target.tag_family) {
            // No tag has this id, so that all are returned as others.
            let Some(mut detector) = TagDetector::new(family, u32::MAX) else { continue };
            for id in detector.search(grey, grey.whole(), self.decimation).others {
                *self.others.entry(((*family).to_owned(), id)).or_default() += 1;
            }
        }
    }

    /// Fits the path to all detections.
    ///
    /// # Errors
    /// When there were no frames, or no segment has enough detections.
    pub fn finish(mut self) -> Result<Track<C>, TrackError> {
        if self.tally.seen == 0 {
            return Err(TrackError::NoFrames);
        }
        let chart = PathChart::new(&self.lens, &self.plane);
        let zero = self.detections.first().map(|detection| detection.time);
        let mut observations = Vec::new();
        let mut seen = Vec::new();
        for detection in std::mem::take(&mut self.detections) {
            let observation =
                zero.and_then(|zero| observe(&detection, zero, &self.lens, &self.plane, &chart));
            match observation {
                Some(observation) => {
                    observations.push(observation);
                    seen.push(detection);
                }
                None => self.withdraw(&detection, LossReason::Unclear),
            }
        }
        let fitter = PathFitter {
            chart,
            corners_mm: self.plane.tag_corners_mm(),
            max_gap_s: self.options.max_gap.as_secs_f64(),
        };
        let Some(fitted) = fitter.fit(&observations) else {
            seen.iter().for_each(|detection| self.withdraw(detection, LossReason::Isolated));
            return Err(self.no_tag());
        };
        for &i in &fitted.outliers {
            self.withdraw(&seen[i], LossReason::Outlier);
        }
        for &i in &fitted.isolated {
            self.withdraw(&seen[i], LossReason::Isolated);
        }
        self.losses.sort_by_key(|loss| loss.frame);
        let used: Vec<_> = fitted.used.iter().map(|&i| seen[i].clone()).collect();
        Ok(self.track(used, &fitted))
    }

    fn withdraw(&mut self, detection: &TagDetection<C>, reason: LossReason) {
        self.tally.withdraw(reason);
        self.losses.push(LostFrame { frame: detection.frame, time: detection.time, reason });
    }

    fn name(&self) -> String {
        format!("{} id {}", self.target.tag_family, self.target.tag_id)
    }

    fn track(self, detections: Vec<TagDetection<C>>, fitted: &FittedPath) -> Track<C> {
        let knots: Vec<TrackKnot<C>> = detections
            .iter()
            .zip(&fitted.estimates)
            .map(|(detection, estimate)| TrackKnot::of(detection.time, estimate))
            .collect();
        let starts = fitted.starts.iter().enumerate().skip(1).filter(|(_, starts)| **starts);
        let gaps = starts
            .map(|(k, _)| TrackGap { from: detections[k - 1].time, to: detections[k].time })
            .collect();
        let squares: f64 = fitted.residuals.iter().map(SVector::norm_squared).sum();
        let n_corners = 4.0 * fitted.residuals.len() as f64;
        Track {
            tag: self.name(),
            plane: self.plane,
            lens: self.lens,
            tally: self.tally,
            losses: self.losses,
            gaps,
            detections,
            knots,
            quality: TrackQuality {
                corner_rms_px: (squares / n_corners).sqrt(),
                variance_factor: fitted.factor,
                turn_jerk: fitted.jerk.turn,
                shift_jerk: fitted.jerk.shift,
                max_gap: self.options.max_gap,
            },
        }
    }

    fn no_tag(&self) -> TrackError {
        let mut others: Vec<_> = self.others.iter().collect();
        // Ties are resolved by the family with the lowest false-positive rate.
        let rank = |family: &str| FAMILIES.iter().position(|known| *known == family);
        others.sort_by_key(|((family, _), n)| (std::cmp::Reverse(**n), rank(family)));
        let named: Vec<_> = others
            .iter()
            .take(3)
            .map(|((family, id), n)| format!("{family} id {id} in {n}"))
            .collect();
        let has = |reason| self.tally.lost.contains_key(&reason);
        let also = if has(LossReason::Mirrored) {
            "; the images are mirrored: flip them before the import (ffmpeg -vf hflip, or numpy's \
             frames[:, :, ::-1]), events as well, or switch the camera's mirroring off"
                .to_owned()
        } else if has(LossReason::Repeated) {
            "; cover or mask all but one of the tags with this id, or print one with another id"
                .to_owned()
        } else if named.is_empty() {
            "; check the view, the focus, and the tag in the rig description".to_owned()
        } else {
            format!(
                "; detected instead: {}; check the tag in the rig description",
                named.join(", ")
            )
        };
        TrackError::NoTag {
            tag: self.name(),
            seen: self.tally.seen,
            reasons: self.tally.reasons(),
            also,
        }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}
