//! Poses of all frames, including those without the tag.
//!
//! Where the tag's track is known, a frame starts from it. Elsewhere it starts from the
//! extrapolated pose of its neighbours and is aligned to the map alone. It is accepted when it ends
//! near the prediction and agrees with the map there.

use super::accumulate::Keyframe;
use super::head::{HeadPose, POSE_DOF};
use super::locate::{LocatedFrame, locate};
use super::path::PathKnot;
use super::photometric::MapReference;
use rayon::prelude::*;

/// Frames located in one batch.
const BATCH_FRAMES: usize = 64;
/// Longest time over which a pose is extrapolated, seconds.
const MAX_EXTRAPOLATION_S: f64 = 0.05;
/// Least share of the visible features that agree with the map in a frame without the tag (an
/// occluder of the tag may hide features).
const MIN_AGREEING_SHARE: f64 = 0.5;
/// Greatest distance from the extrapolated position, pixels.
const MAX_SHIFT_PX: f64 = 3.0;
/// Least number of agreeing features relative to that of the neighbouring frame.
const MIN_NEIGHBOUR_SHARE: f64 = 0.25;

pub(super) struct PendingFrame {
    pub(super) key: Keyframe,
    /// Mid-exposure of the middle row, seconds of the path.
    pub(super) time_s: f64,
    pub(super) has_start: bool,
    pub(super) has_tag: bool,
}

pub(super) struct PoseTracker<'a> {
    reference: &'a MapReference<'a>,
    pending: Vec<PendingFrame>,
    found: Vec<LocatedFrame>,
    n_bridged: usize,
}

impl<'a> PoseTracker<'a> {
    pub(super) fn new(reference: &'a MapReference<'a>) -> Self {
        Self { reference, pending: Vec::new(), found: Vec::new(), n_bridged: 0 }
    }

    /// Whether this time is after all frames so far.
    pub(super) fn is_later(&self, time_s: f64) -> bool {
        let waits = self.pending.last().map(|pending| pending.time_s);
        let last = waits.or_else(|| self.found.last().map(|found| found.knot.time_s));
        last.is_none_or(|last| last < time_s)
    }

    pub(super) fn push(&mut self, pending: PendingFrame) {
        self.pending.push(pending);
        if self.pending.len() >= BATCH_FRAMES {
            self.locate_pending();
        }
    }

    /// All located frames, and how many of them without the tag.
    pub(super) fn finish(mut self) -> (Vec<LocatedFrame>, usize) {
        self.locate_pending();
        (self.found, self.n_bridged)
    }

    fn locate_pending(&mut self) {
        let pending = std::mem::take(&mut self.pending);
        let reference = self.reference;
        let mut located: Vec<Option<LocatedFrame>> = pending
            .par_iter()
            .map(|frame| frame.has_start.then(|| locate(reference, frame.key.clone()))?)
            .collect();
        // Forwards from the located frames, then backwards.
        for i in 0..pending.len() {
            if located[i].is_none() {
                let before = self.found.iter().chain(located[..i].iter().flatten());
                let [last, earlier] = last_two(before);
                located[i] = self.locate_from_neighbours(&pending[i], last, earlier);
            }
        }
        for i in (0..pending.len()).rev() {
            if located[i].is_none() {
                let [next, later] = last_two(located[i + 1..].iter().flatten().rev());
                located[i] = self.locate_from_neighbours(&pending[i], next, later);
            }
        }
        let n_bridged = |(frame, found): &(&PendingFrame, &Option<LocatedFrame>)| {
            !frame.has_tag && found.is_some()
        };
        self.n_bridged += pending.iter().zip(&located).filter(n_bridged).count();
        self.found.extend(located.into_iter().flatten());
    }

    fn locate_from_neighbours(
        &self,
        frame: &PendingFrame,
        near: Option<LocatedFrame>,
        far: Option<LocatedFrame>,
    ) -> Option<LocatedFrame> {
        let near =
            near.filter(|near| (near.knot.time_s - frame.time_s).abs() <= MAX_EXTRAPOLATION_S)?;
        let (pose, speed) =
            extrapolate(&near.knot, far.as_ref().map(|far| &far.knot), frame.time_s);
        let key = Keyframe { pose, speed, ln_gain: near.knot.ln_gain, ..frame.key.clone() };
        let found = locate(self.reference, key)?;
        let per_mm = self.reference.optics.camera.lens.focal_px / pose[2];
        let moved = &found.knot.pose;
        let is_near = (moved[0] - pose[0]).hypot(moved[1] - pose[1]) * per_mm <= MAX_SHIFT_PX;
        let n_agreeing = found.n_agreeing as f64;
        let fits = n_agreeing >= MIN_AGREEING_SHARE * found.n as f64
            && n_agreeing >= MIN_NEIGHBOUR_SHARE * near.n_agreeing as f64;
        (is_near && fits).then_some(found)
    }
}

/// The last two of a sequence, the very last first.
fn last_two<'b>(
    mut all: impl DoubleEndedIterator<Item = &'b LocatedFrame>,
) -> [Option<LocatedFrame>; 2] {
    let last = all.next_back().cloned();
    [last, all.next_back().cloned()]
}

/// Pose and speed at a time by linear extrapolation from `far` through `near`.
fn extrapolate(near: &PathKnot, far: Option<&PathKnot>, time_s: f64) -> (HeadPose, HeadPose) {
    let speed = far.map_or([0.0; POSE_DOF], |far| {
        let length_s = near.time_s - far.time_s;
        if length_s.abs() > MAX_EXTRAPOLATION_S {
            return [0.0; POSE_DOF];
        }
        std::array::from_fn(|i| (near.pose[i] - far.pose[i]) / length_s)
    });
    let pose = std::array::from_fn(|i| near.pose[i] + speed[i] * (time_s - near.time_s));
    (pose, speed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knot(time_s: f64, x: f64) -> PathKnot {
        let pose = [x, 0.0, 200.0, 0.0];
        PathKnot { time_s, pose, pose_error: [0.0; 4], ln_gain: 0.0, misfit: 1.0 }
    }

    #[test]
    fn the_head_goes_on_as_it_came_both_ways_and_rests_after_a_pause() {
        let (pose, speed) = extrapolate(&knot(0.02, 3.0), Some(&knot(0.01, 2.0)), 0.03);
        assert!((pose[0] - 4.0).abs() < 1e-9 && (speed[0] - 100.0).abs() < 1e-6);
        let (pose, speed) = extrapolate(&knot(0.02, 3.0), Some(&knot(0.03, 4.0)), 0.01);
        assert!((pose[0] - 2.0).abs() < 1e-9 && (speed[0] - 100.0).abs() < 1e-6);
        let (pose, speed) = extrapolate(&knot(0.5, 3.0), Some(&knot(0.1, 2.0)), 0.51);
        assert_eq!((pose[0], speed[0]), (3.0, 0.0));
    }
}
