//! Tracker of one tag through the frames of one camera.

use super::corners::{Corners, refine};
use super::detect::{FAMILIES, Look, TagDetector};
use super::fit::{Fitted, Fitter};
use super::grey::{Grey, Light};
use super::lens::Lens;
use super::observe::{observe, sighting};
use super::sighting::{Lost, Sighting, TrackTally};
use super::state::Chart;
use super::target::TargetPlane;
use super::track::{Gap, Knot, Loss, Quality, Track};
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
    pub light: Light,
    /// Longest gap between detections that is interpolated.
    pub max_gap: Span,
    /// Least distance of a corner from the frame's border; a cut-off surrounding biases the outline
    /// fit.
    pub border: Pixels,
}

impl TrackOptions {
    /// Defaults: gaps of at most 150 ms, corners at least 6 px from the border.
    #[must_use]
    pub fn new(light: Light) -> Self {
        Self { light, max_gap: Span::from_micros(150_000), border: Pixels(6.0) }
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
    losses: Vec<Loss<C>>,
    sightings: Vec<Sighting<C>>,
    last_time: Option<Stamp<C>>,
    /// Ids of other tags of the family, and of tags of other families, with counts of frames.
    others: BTreeMap<(String, usize), u64>,
    /// Frames in which other families were searched.
    n_doubted: u64,
}

/// Most frames in which other families are searched, while nothing was detected.
const MAX_DOUBTED: u64 = 8;

/// Least width of a tag that is searched at half resolution: faster, with the same detection rate
/// (C detector: 40 px at blur 1 px).
const WIDE_TAG_PX: f64 = 40.0;

/// Least contrast of a frame, as a share of the full range.
const NO_CONTRAST: f32 = 0.02;

impl<C: Clock> Tracker<C> {
    /// A tracker for the rig's tag in one of its cameras.
    ///
    /// # Errors
    ///
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
        let scale = if matches!(options.light, Light::Mosaic { .. }) { 2.0 } else { 1.0 };
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
            sightings: Vec::new(),
            last_time: None,
            others: BTreeMap::new(),
            n_doubted: 0,
        })
    }

    /// Detects the tag in the next frame. A detection may still be rejected as an outlier in
    /// [`Self::finish`].
    ///
    /// The frame's `timing.row_time` gives the exposure time of each row.
    ///
    /// # Errors
    ///
    /// The reason when the frame has no usable detection; it is counted, and the next frame may
    /// follow.
    pub fn see(&mut self, frame: &Frame<C>) -> Result<&Sighting<C>, Lost> {
        let number = self.tally.seen;
        self.tally.seen += 1;
        let time = frame.timing.mid_exposure(0);
        let seen = self.sight(frame, number, time);
        self.last_time = self.last_time.max(Some(time));
        match seen {
            Ok(sighting) => {
                self.tally.used += 1;
                self.sightings.push(sighting);
                self.sightings.last().ok_or(Lost::NotFound)
            }
            Err(reason) => {
                self.tally.lose(reason);
                self.losses.push(Loss { frame: number, time, reason });
                Err(reason)
            }
        }
    }

    fn sight(
        &mut self,
        frame: &Frame<C>,
        number: u64,
        time: Stamp<C>,
    ) -> Result<Sighting<C>, Lost> {
        if self.last_time.is_some_and(|last| time <= last) {
            return Err(Lost::OutOfOrder);
        }
        let grey = Grey::to_search(frame, self.options.light).ok_or(Lost::Unreadable)?;
        let look = self.find(&grey, time);
        let Some(guess) = look.corners else { return Err(self.explain(frame, &grey, &look)) };
        let size = [frame.size.width, frame.size.height].map(f64::from);
        let border = self.options.border.0;
        let is_clear = |corner: &[f64; 2]| {
            (0..2).all(|axis| (border..=size[axis] - border).contains(&corner[axis]))
        };
        if !guess.iter().all(is_clear) {
            return Err(Lost::AtBorder);
        }
        let corners = self.corners(frame, &grey, guess).ok_or(Lost::Unclear)?;
        Ok(sighting(frame, number, &corners))
    }

    /// Searches the predicted window, then the whole frame.
    fn find(&mut self, grey: &Grey, time: Stamp<C>) -> Look {
        if let Some((expected, margin)) = self.expected(time)
            && let Some(window) = grey.window(&expected, margin)
        {
            self.tally.searched.windows += 1;
            self.tally.searched.window_pixels += window.n_pixels() as u64;
            let look = self.detector.look(grey, window, self.decimation);
            if look.corners.is_some() {
                return look;
            }
        }
        self.tally.searched.whole_frames += 1;
        self.detector.look(grey, grey.whole(), self.decimation)
    }

    /// Predicted corners and the margin of the search window, from the last two detections; None
    /// when those are too old.
    fn expected(&self, time: Stamp<C>) -> Option<([[f64; 2]; 4], f64)> {
        let last = self.sightings.last()?;
        let since = (time - last.time).as_secs_f64();
        if time - last.time > self.options.max_gap {
            return None;
        }
        let side = distance(last.corners_px[0], last.corners_px[1])
            .max(distance(last.corners_px[1], last.corners_px[2]));
        // The tag's white margin of a cell and a half, and the change of its speed.
        let quiet = 0.2 * side + 4.0;
        let before = self.sightings.len().checked_sub(2).map(|i| &self.sightings[i]);
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

    fn corners(&self, frame: &Frame<C>, grey: &Grey, guess: [[f64; 2]; 4]) -> Option<Corners> {
        let Light::Mosaic { black_level_dn } = self.options.light else {
            return refine(grey, guess);
        };
        // Half resolution first: the fit needs a start within half a cell.
        let coarse = refine(grey, guess).map_or(guess, |corners| corners.points);
        let full = Grey {
            width: usize::from(frame.size.width),
            height: usize::from(frame.size.height),
            values: Vec::new(),
            scale: 1,
        };
        let side = distance(coarse[0], coarse[1]);
        let window = full.window(&coarse, 0.15 * side + 2.0)?;
        refine(&Grey::balanced(frame, black_level_dn, window), coarse)
    }

    /// Why a frame has no tag.
    fn explain(&mut self, frame: &Frame<C>, grey: &Grey, look: &Look) -> Lost {
        let full = match frame.samples.bits() {
            8 => 255.0,
            // Ten bits, unless the samples exceed them.
            _ => grey.values.iter().fold(1023.0_f32, |high, value| high.max(*value)),
        };
        if grey.contrast() < NO_CONTRAST * full {
            return Lost::NoContrast;
        }
        for &id in &look.others {
            *self.others.entry((self.target.tag_family.clone(), id)).or_default() += 1;
        }
        if look.others.is_empty() && self.sightings.is_empty() && self.n_doubted < MAX_DOUBTED {
            self.n_doubted += 1;
            self.look_for_other_families(grey);
        }
        if look.others.is_empty() { Lost::NotFound } else { Lost::OtherId }
    }

    /// Counts the tags of other families, of any id.
    fn look_for_other_families(&mut self, grey: &Grey) {
        for family in FAMILIES.iter().filter(|family| **family != self.target.tag_family) {
            // No tag has this id, so that all are returned as others.
            let Some(mut detector) = TagDetector::new(family, u32::MAX) else { continue };
            for id in detector.look(grey, grey.whole(), self.decimation).others {
                *self.others.entry(((*family).to_owned(), id)).or_default() += 1;
            }
        }
    }

    /// Fits the path to all detections.
    ///
    /// # Errors
    ///
    /// When there were no frames, or no segment has enough detections.
    pub fn finish(mut self) -> Result<Track<C>, TrackError> {
        if self.tally.seen == 0 {
            return Err(TrackError::NoFrames);
        }
        let chart = Chart::new(&self.lens, &self.plane);
        let zero = self.sightings.first().map(|sighting| sighting.time);
        let mut observations = Vec::new();
        let mut seen = Vec::new();
        for sighting in std::mem::take(&mut self.sightings) {
            let observation =
                zero.and_then(|zero| observe(&sighting, zero, &self.lens, &self.plane, &chart));
            match observation {
                Some(observation) => {
                    observations.push(observation);
                    seen.push(sighting);
                }
                None => self.withdraw(&sighting, Lost::Unclear),
            }
        }
        let fitter = Fitter {
            chart,
            corners_mm: self.plane.tag_corners_mm(),
            max_gap_s: self.options.max_gap.as_secs_f64(),
        };
        let Some(fitted) = fitter.fit(&observations) else {
            seen.iter().for_each(|sighting| self.withdraw(sighting, Lost::Isolated));
            return Err(self.no_tag());
        };
        for &i in &fitted.outliers {
            self.withdraw(&seen[i], Lost::Outlier);
        }
        for &i in &fitted.isolated {
            self.withdraw(&seen[i], Lost::Isolated);
        }
        self.losses.sort_by_key(|loss| loss.frame);
        let used: Vec<_> = fitted.used.iter().map(|&i| seen[i].clone()).collect();
        Ok(self.track(used, &fitted))
    }

    fn withdraw(&mut self, sighting: &Sighting<C>, reason: Lost) {
        self.tally.withdraw(reason);
        self.losses.push(Loss { frame: sighting.frame, time: sighting.time, reason });
    }

    fn name(&self) -> String {
        format!("{} id {}", self.target.tag_family, self.target.tag_id)
    }

    fn track(self, sightings: Vec<Sighting<C>>, fitted: &Fitted) -> Track<C> {
        let knots: Vec<Knot<C>> = sightings
            .iter()
            .zip(&fitted.beliefs)
            .map(|(sighting, belief)| Knot::of(sighting.time, belief))
            .collect();
        let starts = fitted.starts.iter().enumerate().skip(1).filter(|(_, starts)| **starts);
        let gaps = starts
            .map(|(k, _)| Gap { from: sightings[k - 1].time, to: sightings[k].time })
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
            sightings,
            knots,
            quality: Quality {
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
        let also = if named.is_empty() {
            "; is the target in the picture, in focus, and does the rig name its tag?".to_owned()
        } else {
            format!("; seen instead: {}; does the rig name the right tag?", named.join(", "))
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
