//! Errors of a fitted hypothesis that hold although the model is not the truth.
//!
//! The curvature of the log-likelihood says how far a value moves when the slope does; how much
//! the slope scatters is seen from the data, between tiles of pixels and between blocks of time
//! (Huber, 1967; White, Econometrica 50, 1982; two ways of clustering after Cameron, Gelbach and
//! Miller, J. Bus. Econ. Stat. 29, 2011). The slopes' own product in place of the curvature
//! would claim to know the more, the less the model fits.

use super::cell_scores::Part;
use super::curvature_probes::{About, Four, moved};
use super::fitted::{Errors, Fitted};
use super::gauss_newton::as_it_is;
use super::laplace::{Summit, apart};
use super::local_refinement::pixels_for;
use crate::diagnose::{Evidence, Hypothesis};
use nalgebra::DMatrix;
use std::sync::Arc;

/// Rounds of going to a parabola's top, and the gain in nats that ends them.
const ROUNDS: usize = 6;
const ENOUGH: f64 = 0.05;

/// What a top may lie below the fit, as a share of what the log-likelihood falls by along the roughest direction: a
/// search stays on the highest of many small steps.
const BELOW: f64 = 0.5;

/// Shares of the way to a top that are tried, until one leads up.
const SHARES: [f64; 2] = [1.0, 0.3];

/// Pixels on which the curvature is taken, and work of an evaluation, in instants of light, with which it is taken
/// on fewer, but on so many.
const PIXELS: usize = 160;
const WORK: usize = 3_000_000;
const LEAST_PIXELS: usize = 40;

/// Lengths of the directions behind which they are looked for anew.
const FAR_OFF: f64 = 1.0;

/// The fit at its summit, with the standard errors of all values inside their ranges.
pub(crate) fn with_errors(evidence: &Evidence, fitted: Fitted) -> Fitted {
    let (fitted, summit) = climbed(evidence, fitted);
    let Some(summit) = summit else { return fitted };
    let of = summit.errors(&fitted.cells, evidence.blocks.n());
    Fitted { errors: Some(Arc::new(Errors { summit, of })), ..fitted }
}

/// A fit gone to the top of the parabola about it, and what is there; `None` where nothing may move.
pub(crate) fn climbed(evidence: &Evidence, fitted: Fitted) -> (Fitted, Option<Summit>) {
    let Some(mut summit) = Summit::of(evidence, &fitted) else { return (fitted, None) };
    let (top, way) = summit.climb(evidence, fitted);
    if way > FAR_OFF {
        let there = Summit::of(evidence, &top);
        return (top, there);
    }
    (top, Some(summit))
}

impl Summit {
    fn of(evidence: &Evidence, fitted: &Fitted) -> Option<Self> {
        let all = inside(&fitted.hypothesis);
        let held = fitted.held(evidence);
        let wanted = pixels_for(evidence, &held.hypothesis, WORK, [LEAST_PIXELS, PIXELS]);
        let few = evidence.thinned((evidence.pixels.len() + wanted / 2) / wanted);
        let mut about = About::of(&few, &held.hypothesis, &held.cells, &all);
        let star = about.own_directions();
        let (told, untold) = about.told(&star);
        let free: Vec<usize> = told.iter().map(|&i| all[i]).collect();
        if free.is_empty() {
            return None;
        }
        let spreads = about.spreads(&untold);
        let untold = untold.iter().map(|&i| all[i]).zip(spreads).collect();
        let star = star.select_columns(&told).select_rows(&told);
        let about = about.of_some(&told, &free);
        let directions = about.long_enough(unmixed(&about, &star)?);
        let minus = about.told_mixed(&directions)?;
        let four = Four::of(evidence, &held.hypothesis, &free, &directions);
        let falls = about.falls;
        Self { free, untold, directions, minus, falls, ..Self::default() }.with(&four)
    }

    /// The same directions as they are seen by a part of the evidence, from a fit to it.
    pub(crate) fn of_part(&self, part: &Evidence, fitted: &Fitted) -> Option<Self> {
        self.clone().with(&self.four(part, fitted))
    }

    fn four(&self, evidence: &Evidence, fitted: &Fitted) -> Four {
        Four::of(evidence, &fitted.held(evidence).hypothesis, &self.free, &self.directions)
    }

    /// A fit gone to the top, along the same directions all the way, and how many of their lengths it was.
    pub(crate) fn climb(&mut self, evidence: &Evidence, mut fitted: Fitted) -> (Fitted, f64) {
        let mut way = 0.0;
        for _ in 0..ROUNDS {
            let (change, gain) = self.top();
            if gain < ENOUGH {
                break;
            }
            let at = |share| {
                let change = &self.directions * &change * share;
                as_it_is(evidence, moved(&fitted.hypothesis, &self.free, &change))
            };
            let below = BELOW * self.falls.iter().copied().fold(0.0, f64::max);
            let is_up = |(_, top): &(f64, Fitted)| nats(top) > nats(&fitted) - below;
            let mut tops = SHARES.into_iter().map(|share| (share, at(share)));
            let Some((share, top)) = tops.find(is_up) else { break };
            let Some(there) = self.clone().with(&self.four(evidence, &top)) else { break };
            way += share * change.norm();
            (*self, fitted) = (there, top);
        }
        (fitted, way)
    }
}

/// Log-likelihood of the training cells.
fn nats(fitted: &Fitted) -> f64 {
    fitted.cells.total(Part::Training)
}

/// The values that may move: one at an end of its range is held there by it.
fn inside(hypothesis: &Hypothesis) -> Vec<usize> {
    let is_inside = |&i: &usize| {
        let ([low, high], value) = (hypothesis.ranges[i], hypothesis.values[i]);
        let margin = 1e-9 * (high - low);
        hypothesis.steps[i] > 0.0 && value > low + margin && value < high - margin
    };
    (0..hypothesis.values.len()).filter(is_inside).collect()
}

/// Directions along which the curvature is the same and which do not mix where `star`, each value by itself,
/// has been. A value with little room stays a direction of its own, or it would leave the others none either. Values
/// along which the log-likelihood is rough mix among themselves: a little of them in every direction would make all
/// of these as rough.
fn unmixed(about: &About<'_>, star: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let minus = about.curvature(star)?;
    let roomy = (0..star.ncols()).filter(|&i| !about.is_cramped(star, i));
    let (rough, smooth): (Vec<usize>, Vec<usize>) = roomy.partition(|&i| about.is_rough(i));
    let mut directions = star.clone();
    for group in [rough, smooth].into_iter().filter(|group| !group.is_empty()) {
        let minus = minus.select_columns(&group).select_rows(&group);
        let falls: Vec<f64> = group.iter().map(|&i| about.falls[i]).collect();
        let shares = apart(&minus, &falls)?;
        for (&column, shares) in group.iter().zip(shares.column_iter()) {
            directions.column_mut(column).fill(0.0);
            let own = group.iter().zip(shares.iter());
            own.for_each(|(&row, share)| directions[(row, column)] = star[(row, row)] * share);
        }
    }
    Some(directions)
}
