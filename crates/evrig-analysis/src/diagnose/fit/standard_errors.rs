//! Standard errors under model misspecification.
//!
//! Sandwich estimator: the curvature of the log-likelihood and the scatter of its gradient over
//! tiles and over blocks (Huber, 1967; White, Econometrica 50, 1982; two-way clustering after
//! Cameron, Gelbach and Miller, J. Bus. Econ. Stat. 29, 2011). The inverse curvature alone would
//! be too small for a model that does not fit.

use super::cell_scores::CellSet;
use super::curvature_probes::{CellProbes, CurvatureProbes, moved};
use super::fitted::{FittedModel, StandardErrors};
use super::gauss_newton::score_model;
use super::laplace::{LaplaceApproximation, conjugate_directions};
use super::local_refinement::pixels_within_work;
use crate::diagnose::{Evidence, Hypothesis};
use nalgebra::DMatrix;
use std::sync::Arc;

/// Newton steps on the Laplace approximation, and gain in nats that ends them.
const MAX_NEWTON_STEPS: usize = 6;
const MIN_NEWTON_GAIN_NATS: f64 = 0.05;

/// A step may lower the likelihood by this share of the largest drop target: a search ends on a
/// noise peak.
const MAX_DECREASE_SHARE: f64 = 0.5;

/// Shares of a Newton step that are tried.
const STEP_SHARES: [f64; 2] = [1.0, 0.3];

/// Pixels for the curvature: at most, work budget in instants of light, and at least.
const MAX_CURVATURE_PIXELS: usize = 160;
const MAX_CURVATURE_WORK: usize = 3_000_000;
const MIN_CURVATURE_PIXELS: usize = 40;

/// Distance, in lengths of the directions, beyond which the directions are computed anew.
const MAX_STEP_LENGTH: f64 = 1.0;

/// The fit at its maximum, with standard errors.
pub(crate) fn with_standard_errors(evidence: &Evidence, fitted: FittedModel) -> FittedModel {
    let (fitted, laplace) = climb_to_maximum(evidence, fitted);
    let Some(laplace) = laplace else { return fitted };
    let of = laplace.errors(&fitted.cells, evidence.blocks.n());
    FittedModel { errors: Some(Arc::new(StandardErrors { laplace, of })), ..fitted }
}

/// Newton steps to the maximum, and the Laplace approximation there; `None` without free values.
pub(crate) fn climb_to_maximum(
    evidence: &Evidence,
    fitted: FittedModel,
) -> (FittedModel, Option<LaplaceApproximation>) {
    let Some(mut laplace) = LaplaceApproximation::of(evidence, &fitted) else {
        return (fitted, None);
    };
    let (top, way) = laplace.climb(evidence, fitted);
    if way > MAX_STEP_LENGTH {
        let there = LaplaceApproximation::of(evidence, &top);
        return (top, there);
    }
    (top, Some(laplace))
}

impl LaplaceApproximation {
    fn of(evidence: &Evidence, fitted: &FittedModel) -> Option<Self> {
        let all = free_inside_range(&fitted.hypothesis);
        let held = fitted.with_shared_grid(evidence);
        let wanted = pixels_within_work(
            evidence,
            &held.hypothesis,
            MAX_CURVATURE_WORK,
            [MIN_CURVATURE_PIXELS, MAX_CURVATURE_PIXELS],
        );
        let few = evidence.thinned((evidence.pixels.len() + wanted / 2) / wanted);
        let mut probes = CurvatureProbes::of(&few, &held.hypothesis, &held.cells, &all);
        let coordinates = probes.coordinate_directions();
        let (identified, bound_limited) = probes.split_by_identifiability(&coordinates);
        let free: Vec<usize> = identified.iter().map(|&i| all[i]).collect();
        if free.is_empty() {
            return None;
        }
        let errors = probes.bound_limited_errors(&bound_limited);
        let bound_limited = bound_limited.iter().map(|&i| all[i]).zip(errors).collect();
        let coordinates = coordinates.select_columns(&identified).select_rows(&identified);
        let probes = probes.of_some(&identified, &free);
        let directions = probes.scaled_to_drop(decorrelated_directions(&probes, &coordinates)?);
        let minus = probes.significant_cross_terms(&directions)?;
        let cells = CellProbes::of(evidence, &held.hypothesis, &free, &directions);
        let drop_targets = probes.drop_targets;
        Self { free, bound_limited, directions, minus, drop_targets, ..Self::default() }
            .with_probes(&cells)
    }

    /// The same directions probed on part of the evidence.
    pub(crate) fn of_part(&self, part: &Evidence, fitted: &FittedModel) -> Option<Self> {
        self.clone().with_probes(&self.probe_cells(part, fitted))
    }

    fn probe_cells(&self, evidence: &Evidence, fitted: &FittedModel) -> CellProbes {
        CellProbes::of(
            evidence,
            &fitted.with_shared_grid(evidence).hypothesis,
            &self.free,
            &self.directions,
        )
    }

    /// Newton steps along fixed directions, and their total length.
    pub(crate) fn climb(
        &mut self,
        evidence: &Evidence,
        mut fitted: FittedModel,
    ) -> (FittedModel, f64) {
        let mut way = 0.0;
        for _ in 0..MAX_NEWTON_STEPS {
            let (change, gain) = self.newton_step();
            if gain < MIN_NEWTON_GAIN_NATS {
                break;
            }
            let at = |share| {
                let change = &self.directions * &change * share;
                score_model(evidence, moved(&fitted.hypothesis, &self.free, &change))
            };
            let below = MAX_DECREASE_SHARE * self.drop_targets.iter().copied().fold(0.0, f64::max);
            let is_up = |(_, top): &(f64, FittedModel)| nats(top) > nats(&fitted) - below;
            let mut tops = STEP_SHARES.into_iter().map(|share| (share, at(share)));
            let Some((share, top)) = tops.find(is_up) else { break };
            let Some(there) = self.clone().with_probes(&self.probe_cells(evidence, &top)) else {
                break;
            };
            way += share * change.norm();
            (*self, fitted) = (there, top);
        }
        (fitted, way)
    }
}

fn nats(fitted: &FittedModel) -> f64 {
    fitted.cells.total(CellSet::Training)
}

/// Indices of the values inside their ranges.
fn free_inside_range(hypothesis: &Hypothesis) -> Vec<usize> {
    let is_inside = |&i: &usize| {
        let ([low, high], value) = (hypothesis.ranges[i], hypothesis.values[i]);
        let margin = 1e-9 * (high - low);
        hypothesis.steps[i] > 0.0 && value > low + margin && value < high - margin
    };
    (0..hypothesis.values.len()).filter(is_inside).collect()
}

/// Decorrelated directions with equal curvature. A range-limited value stays a direction of its
/// own, since it would shorten the others. Values with numerical noise mix among themselves only.
fn decorrelated_directions(
    probes: &CurvatureProbes<'_>,
    coordinates: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let minus = probes.curvature(coordinates)?;
    let roomy = (0..coordinates.ncols()).filter(|&i| !probes.is_bound_limited(coordinates, i));
    let (rough, smooth): (Vec<usize>, Vec<usize>) = roomy.partition(|&i| probes.is_rough(i));
    let mut directions = coordinates.clone();
    for group in [rough, smooth].into_iter().filter(|group| !group.is_empty()) {
        let minus = minus.select_columns(&group).select_rows(&group);
        let drop_targets: Vec<f64> = group.iter().map(|&i| probes.drop_targets[i]).collect();
        let shares = conjugate_directions(&minus, &drop_targets)?;
        for (&column, shares) in group.iter().zip(shares.column_iter()) {
            directions.column_mut(column).fill(0.0);
            let own = group.iter().zip(shares.iter());
            own.for_each(|(&row, share)| {
                directions[(row, column)] = coordinates[(row, row)] * share
            });
        }
    }
    Some(directions)
}
