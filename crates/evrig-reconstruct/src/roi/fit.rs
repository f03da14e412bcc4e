//! Fit of a path to detections: process noise densities, outliers, gaps, error.

use super::smooth::{Belief, Corners, Jerk, Observation, Smoother};
use super::state::{Chart, State};
use evrig_core::stats::quantile_sorted;

/// A detection is an outlier when its squared residual exceeds the median by this factor over
/// [`MEDIAN_CHI2`]: probability 1e-7 (chi-squared, eight degrees of freedom).
const OUTLIER: f64 = 47.0;

/// Median of chi-squared with eight degrees of freedom.
const USUAL: f64 = 7.344;

/// Fewest detections of a path segment.
const MIN_SIGHTINGS: usize = 4;

/// Step factor of the search for densities.
const DENSITY_STEP: f64 = 4.0;

/// Process noise of the shape per second: a thousandth in foreshortening, a tilt of 0.06 degrees.
const SHAPE_PER_S: f64 = 1e-6;

/// A path fitted to detections.
pub(super) struct Fitted {
    /// Indices of the detections used.
    pub(super) used: Vec<usize>,
    /// Indices of outliers.
    pub(super) outliers: Vec<usize>,
    /// Indices of detections with too few neighbours.
    pub(super) isolated: Vec<usize>,
    /// States at the used detections, with covariances scaled to the residuals.
    pub(super) beliefs: Vec<Belief>,
    /// Whether a path segment begins at a used detection.
    pub(super) starts: Vec<bool>,
    pub(super) residuals: Vec<Corners>,
    pub(super) jerk: Jerk,
    /// Factor by which the corners' covariances were too small.
    pub(super) factor: f64,
}

/// Common parameters of all fits of one track.
pub(super) struct Fitter {
    pub(super) chart: Chart,
    pub(super) corners_mm: [[f64; 2]; 4],
    /// Longest gap between detections that is interpolated, seconds.
    pub(super) max_gap_s: f64,
}

impl Fitter {
    /// Fits a path; None when no segment has enough detections or the numbers fail.
    pub(super) fn fit(&self, observations: &[Observation]) -> Option<Fitted> {
        let mut used: Vec<usize> = (0..observations.len()).collect();
        let mut isolated = self.drop_isolated(observations, &mut used);
        let (mut chosen, mut starts) = self.choose(observations, &used)?;
        let first = Jerk { turn: 1e4, shift: 1e6, shape_per_s: SHAPE_PER_S };
        let smoother = self.smoother(&chosen);
        let mut guess = smoother.first_guess();
        let mut jerk = climb(&smoother, &guess, first, true)?;
        let mut smoothed = smoother.smooth(&guess, jerk, true)?;
        guess = smoothed.beliefs.iter().map(|belief| belief.mean).collect();
        smoothed = smoother.smooth(&guess, jerk, true)?;
        let mut sorted = smoothed.squares.clone();
        sorted.sort_by(f64::total_cmp);
        let usual = (quantile_sorted(&sorted, 0.5) / USUAL).max(0.5);
        let is_outlier = |k: usize| smoothed.squares[k] > OUTLIER * usual;
        let outliers: Vec<usize> =
            used.iter().enumerate().filter(|(k, _)| is_outlier(*k)).map(|(_, &i)| i).collect();
        let mut guess: Vec<State> = smoothed.beliefs.iter().map(|belief| belief.mean).collect();
        if !outliers.is_empty() {
            used.retain(|i| !outliers.contains(i));
            let more = self.drop_isolated(observations, &mut used);
            isolated.extend(more);
            (chosen, starts) = self.choose(observations, &used)?;
            guess = self.smoother(&chosen).first_guess();
        }
        let smoother = self.smoother(&chosen);
        jerk = climb(&smoother, &guess, jerk, false)?;
        for _ in 0..2 {
            smoothed = smoother.smooth(&guess, jerk, false)?;
            guess = smoothed.beliefs.iter().map(|belief| belief.mean).collect();
        }
        let (_, factor) = smoother.likelihood(&guess, jerk, false)?;
        for belief in &mut smoothed.beliefs {
            belief.covariance *= factor;
        }
        let jerk = Jerk { turn: jerk.turn * factor, shift: jerk.shift * factor, ..jerk };
        let (beliefs, residuals) = (smoothed.beliefs, smoothed.residuals);
        Some(Fitted { used, outliers, isolated, beliefs, starts, residuals, jerk, factor })
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
            stretches.filter(|s| s.len() < MIN_SIGHTINGS).flatten().copied().collect();
        used.retain(|i| isolated.binary_search(i).is_err());
        isolated
    }
}

/// Maximum-likelihood densities by coordinate-wise search.
fn climb(smoother: &Smoother<'_>, guess: &[State], first: Jerk, is_wary: bool) -> Option<Jerk> {
    let value = |jerk: Jerk| Some(smoother.likelihood(guess, jerk, is_wary)?.0);
    let mut best = (value(first)?, first);
    let scale: [fn(Jerk, f64) -> Jerk; 3] = [
        |jerk, by| Jerk { turn: jerk.turn * by, shift: jerk.shift * by, ..jerk },
        |jerk, by| Jerk { shift: jerk.shift * by, ..jerk },
        |jerk, by| Jerk { turn: jerk.turn * by, ..jerk },
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
