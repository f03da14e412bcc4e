//! Events that the pixel fired and nobody saw.
//!
//! Behind a lost event the pixel compares with another value, On and Off: where it turns back it fires
//! sooner. While the signal goes on past a threshold both ways stay open as one case; once one of them is
//! all but certain, or the signal has turned and they differ, they part.

use super::course::{Course, Reach};
use super::memory::{Case, LEAST_WEIGHT, Memory, gather};

/// Ways less likely than this come to nothing, however many are gathered.
const NOTHING: f64 = LEAST_WEIGHT * LEAST_WEIGHT;

/// A case that is this sure to have fired unseen is followed as such.
const SURE: f64 = 0.98;

/// A chance this small to have fired unseen does not matter.
const MAY_BE: f64 = 0.02;

/// By this share of a threshold the signal has turned.
const TURNED: f64 = 0.15;

/// Lost events blur what the pixel compares with, but by no more than this many times.
const MOST_BLUR: f64 = 2.5;

impl Memory {
    /// Whether a case is to be parted, the signal having come to a height.
    pub(super) fn is_to_part(&self, reach: Reach, height: f64) -> bool {
        self.cases().iter().any(|case| {
            let gone = case.gone(reach);
            (0..2).any(|side| {
                let threshold = case.thresholds[side];
                if !threshold.may_have_fired(gone[side]) {
                    return false;
                }
                let fired = threshold.fired_unseen(case.begin[side], gone[side]);
                let back = gone[side] - case.change(height, side == 0);
                fired >= SURE || fired >= MAY_BE && back >= TURNED * threshold.theta()
            })
        })
    }

    /// Parts every case into one that has not fired and those that have, unseen. Cases weighed; the
    /// signal counts from `position` on.
    pub(super) fn part(&mut self, course: &Course<'_>, reach: Reach, position: f64) {
        let height = course.height(position);
        let noise = course.noise(position);
        let cases = self.take();
        let ways = cases.iter().flat_map(|case| {
            let gone = case.gone(reach);
            let fired =
                [0, 1].map(|side| case.thresholds[side].fired_unseen(case.begin[side], gone[side]));
            let waits = Case {
                weight: case.weight * (1.0 - fired[0]) * (1.0 - fired[1]),
                ..case.begun_at(gone)
            };
            let unseen = [0, 1].map(|side| Case {
                weight: case.weight * fired[side] * (1.0 - fired[1 - side]),
                ..behind(course, case, side, gone[side], height, noise)
            });
            [waits].into_iter().chain(unseen)
        });
        let mut parted = Vec::new();
        for way in ways.filter(|way| way.weight >= NOTHING) {
            gather(&mut parted, way);
        }
        self.set(parted);
    }
}

/// How a pixel stands that has fired on one side unseen, the signal having gone so far on that side and
/// being at `height` now.
fn behind(
    course: &Course<'_>,
    case: &Case,
    side: usize,
    gone: f64,
    height: f64,
    noise: f64,
) -> Case {
    let theta = case.thresholds[side].theta();
    let value = if side == 0 { case.value + theta } else { case.value - theta };
    let blurred = case.noise.hypot(noise).min(MOST_BLUR * noise);
    let mut fired = Case::new(course, value, blurred);
    fired.gone[side] = (gone - theta).max(0.0);
    fired.gone[1 - side] = fired.change(height, side != 0).max(0.0);
    fired
}
