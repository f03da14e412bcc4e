//! Fit of a path to detections: process noise densities, outliers, gaps, error.

use super::path_state::{PathChart, PathState};
use super::smoother::{CornerVector, JerkDensity, Observation, Smoother, StateEstimate};
use evrig_core::stats::quantile_sorted;

/// A detection is an outlier when its squared residual exceeds the median by this factor over
/// [`MEDIAN_CHI2`]: probability 1e-7 (chi-squared, eight degrees of freedom).
const OUTLIER_CHI2: f64 = 47.0;
/// Median of chi-squared with eight degrees of freedom.
const MEDIAN_CHI2: f64 = 7.344;
/// Fewest detections of a path segment.
const MIN_DETECTIONS: usize = 4;
/// Step factor of the search for densities.
const DENSITY_STEP: f64 = 4.0;
/// Process noise of the shape per second: a thousandth in foreshortening, a tilt of 0.06 degrees.
const SHAPE_PER_S: f64 = 1e-6;

pub(super) struct FittedPath {
    /// Indices of the detections used.
    pub(super) used: Vec<usize>,
    pub(super) outliers: Vec<usize>,
    /// Indices of detections with too few neighbours.
    pub(super) isolated: Vec<usize>,
    /// States at the used detections, with covariances scaled to the residuals.
    pub(super) estimates: Vec<StateEstimate>,
    /// Whether a path segment begins at a used detection.
    pub(super) starts: Vec<bool>,
    pub(super) residuals: Vec<CornerVector>,
    pub(super) jerk: JerkDensity,
    /// Factor by which the corners' covariances were too small.
    pub(super) factor: f64,
}

/// Common parameters of all fits of one track.
pub(super) struct PathFitter {
    pub(super) chart: PathChart,
    pub(super) corners_mm: [[f64; 2]; 4],
    /// Longest gap between detections that is interpolated, seconds.
    pub(super) max_gap_s: f64,
}

impl PathFitter {
    /// Fits a path; None when no segment has enough detections or the numbers fail.
    pub(super) fn fit(&self, observations: &[Observation]) -> Option<FittedPath> {
        let mut used: Vec<usize> = (0..observations.len()).collect();
        let mut isolated = self.drop_isolated(observations, &mut used);
        let (mut chosen, mut starts) = self.choose(observations, &used)?;
        let first = JerkDensity { turn: 1e4, shift: 1e6, shape_per_s: SHAPE_PER_S };
        let smoother = self.smoother(&chosen);
        let mut guess = smoother.first_guess();
        let mut jerk = maximise_likelihood(&smoother, &guess, first, true)?;
        let mut smoothed = smoother.smooth(&guess, jerk, true)?;
        guess = smoothed.estimates.iter().map(|estimate| estimate.mean).collect();
        smoothed = smoother.smooth(&guess, jerk, true)?;
        let mut sorted = smoothed.squares.clone();
        sorted.sort_by(f64::total_cmp);
        let misfit = (quantile_sorted(&sorted, 0.5) / MEDIAN_CHI2).max(0.5);
        let is_outlier = |k: usize| smoothed.squares[k] > OUTLIER_CHI2 * misfit;
        let outliers: Vec<usize> =
            used.iter().enumerate().filter(|(k, _)| is_outlier(*k)).map(|(_, &i)| i).collect();
        let mut guess: Vec<PathState> =
            smoothed.estimates.iter().map(|estimate| estimate.mean).collect();
        if !outliers.is_empty() {
            used.retain(|i| !outliers.contains(i));
            let more = self.drop_isolated(observations, &mut used);
            isolated.extend(more);
            (chosen, starts) = self.choose(observations, &used)?;
            guess = self.smoother(&chosen).first_guess();
        }
        let smoother = self.smoother(&chosen);
        jerk = maximise_likelihood(&smoother, &guess, jerk, false)?;
        for _ in 0..2 {
            smoothed = smoother.smooth(&guess, jerk, false)?;
            guess = smoothed.estimates.iter().map(|estimate| estimate.mean).collect();
        }
        let (_, factor) = smoother.likelihood(&guess, jerk, false)?;
        for estimate in &mut smoothed.estimates {
            estimate.covariance *= factor;
        }
        let jerk = JerkDensity { turn: jerk.turn * factor, shift: jerk.shift * factor, ..jerk };
        let (estimates, residuals) = (smoothed.estimates, smoothed.residuals);
        Some(FittedPath { used, outliers, isolated, estimates, starts, residuals, jerk, factor })
    }

    fn smoother<'a>(&self, observations: &'a [Observation]) -> Smoother<'a> {
        Smoother { chart: self.chart, corners_mm: self.corners_mm, observations }
    }

    /// The used observations with segment starts marked; None when there is none.
    fn choose(
        &self,
        observations: &[Observation],
        used: &[usize],
    ) -> Option<(Vec<Observation>, Vec<bool>)> {
        let mut chosen: Vec<Observation> = used.iter().map(|&i| observations[i].clone()).collect();
        for k in 0..chosen.len() {
            chosen[k].is_start = k == 0 || chosen[k].at_s - chosen[k - 1].at_s > self.max_gap_s;
        }
        let starts = chosen.iter().map(|observation| observation.is_start).collect();
        (!chosen.is_empty()).then_some((chosen, starts))
    }

    /// Removes segments that are too short and returns them.
    fn drop_isolated(&self, observations: &[Observation], used: &mut Vec<usize>) -> Vec<usize> {
        let joins =
            |a: &usize, b: &usize| observations[*b].at_s - observations[*a].at_s <= self.max_gap_s;
        let stretches = used.chunk_by(joins);
        let isolated: Vec<usize> =
            stretches.filter(|s| s.len() < MIN_DETECTIONS).flatten().copied().collect();
        used.retain(|i| isolated.binary_search(i).is_err());
        isolated
    }
}

/// Maximum-likelihood densities by coordinate-wise search.
fn maximise_likelihood(
    smoother: &Smoother<'_>,
    guess: &[PathState],
    first: JerkDensity,
    is_robust: bool,
) -> Option<JerkDensity> {
    let value = |jerk: JerkDensity| Some(smoother.likelihood(guess, jerk, is_robust)?.0);
    let mut best = (value(first)?, first);
    let scale: [fn(JerkDensity, f64) -> JerkDensity; 3] = [
        |jerk, by| JerkDensity { turn: jerk.turn * by, shift: jerk.shift * by, ..jerk },
        |jerk, by| JerkDensity { shift: jerk.shift * by, ..jerk },
        |jerk, by| JerkDensity { turn: jerk.turn * by, ..jerk },
    ];
    for scaled in scale {
        for by in [DENSITY_STEP, 1.0 / DENSITY_STEP] {
            // 40 factors of 4 cover any motion.
            for _ in 0..40 {
                let jerk = scaled(best.1, by);
                let is_in_range = (1e-6..1e18).contains(&jerk.turn.min(jerk.shift));
                let Some(there) = value(jerk).filter(|_| is_in_range) else { break };
                if there <= best.0 {
                    break;
                }
                best = (there, jerk);
            }
        }
    }
    Some(best.1)
}
