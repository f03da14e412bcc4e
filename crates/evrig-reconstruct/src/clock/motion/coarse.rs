//! Initial offset by a grid search, with a test for ambiguity.

use super::path::PathSpline;
use super::samples::TrackPoint;
use crate::clock::error::ClockError;

use evrig_core::stats::Estimate;
use evrig_core::time::Span;

/// Grid spacing, seconds.
const STEP_S: f64 = 0.005;
/// Most samples used; more do not improve the grid search.
const MAX_SAMPLES: usize = 1_500;
/// Difference in chi-squared below which two offsets are indistinguishable.
const AMBIGUITY_CHI2: f64 = 25.0;
/// Least chi-squared that a common motion must explain.
const MIN_EXPLAINED: f64 = 200.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CoarseStart {
    pub(super) tau_s: f64,
    /// Another offset that fits about as well, separated by worse ones.
    pub(super) alternative_s: Option<f64>,
    pub(super) ln_scale: f64,
    pub(super) roll: f64,
    /// Position in the other camera of the reference's mean position.
    pub(super) shift: [f64; 2],
    pub(super) centre: [f64; 2],
}

/// The best offset of the grid, with the geometry that goes with it.
pub(super) fn search(
    path: &PathSpline,
    other: &[TrackPoint],
    search_s: f64,
    roll_deg: Option<Estimate>,
) -> Result<CoarseStart, ClockError> {
    let stride = other.len().div_ceil(MAX_SAMPLES);
    let sample: Vec<TrackPoint> = other.iter().copied().step_by(stride).collect();
    let n_steps = (search_s / STEP_S).ceil() as i64;
    let grid: Vec<(f64, CoarseStart, f64)> = (-n_steps..=n_steps)
        .map(|step| (step as f64 * STEP_S).clamp(-search_s, search_s))
        .map(|tau_s| similarity(path, &sample, tau_s, roll_deg))
        .collect();
    let costs: Vec<f64> = grid.iter().map(|(cost, ..)| *cost).collect();
    let best = (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
    // Where the model misfits, differences of chi-squared are scaled by the misfit.
    let unit = (costs[best] / (2 * sample.len()) as f64).max(1.0);
    let is_alternative = |&at: &usize| {
        let between = if at < best { &costs[at..=best] } else { &costs[best..=at] };
        let barrier = between.iter().copied().fold(0.0, f64::max);
        let threshold = AMBIGUITY_CHI2 * unit;
        costs[at] - costs[best] < threshold && barrier - costs[at] > threshold
    };
    let alternative = (0..costs.len()).find(is_alternative);
    if grid[best].2 < MIN_EXPLAINED * unit {
        let search = Span::from_secs_f64(search_s);
        return Err(ClockError::WeakMotion { error: search, search });
    }
    Ok(CoarseStart {
        alternative_s: alternative.map(|alternative| grid[alternative].1.tau_s),
        ..grid[best].1
    })
}

/// The similarity that fits best at one offset, in closed form, with the chi-squared it
/// leaves and the chi-squared it explains.
fn similarity(
    path: &PathSpline,
    other: &[TrackPoint],
    tau_s: f64,
    roll_deg: Option<Estimate>,
) -> (f64, CoarseStart, f64) {
    let seen: Vec<[f64; 2]> =
        other.iter().map(|point| path.position(&path.basis(point.t_s + tau_s))).collect();
    let weights: Vec<f64> = other.iter().map(|point| point.error.powi(-2)).collect();
    let total: f64 = weights.iter().sum();
    let mean = |axis: usize, of: &dyn Fn(usize) -> [f64; 2]| {
        weights.iter().enumerate().map(|(i, w)| w * of(i)[axis]).sum::<f64>() / total
    };
    let centre = [0, 1].map(|axis| mean(axis, &|i| seen[i]));
    let shift = [0, 1].map(|axis| mean(axis, &|i| other[i].p));
    let (mut along, mut across, mut size, mut spread) = (0.0, 0.0, 0.0, 0.0);
    for ((q, point), w) in seen.iter().zip(other).zip(&weights) {
        let q = [q[0] - centre[0], q[1] - centre[1]];
        let p = [point.p[0] - shift[0], point.p[1] - shift[1]];
        along += w * (q[0] * p[0] + q[1] * p[1]);
        across += w * (q[0] * p[1] - q[1] * p[0]);
        size += w * (q[0] * q[0] + q[1] * q[1]);
        spread += w * (p[0] * p[0] + p[1] * p[1]);
    }
    let roll = across.atan2(along);
    let size = size.max(f64::MIN_POSITIVE);
    let scale = along.hypot(across) / size;
    let prior = roll_deg.map_or(0.0, |prior| {
        let off = (roll.to_degrees() - prior.value + 180.0).rem_euclid(360.0) - 180.0;
        (off / prior.standard_error).powi(2)
    });
    let explained = scale * scale * size;
    let cost = spread - explained + prior;
    let ln_scale = scale.max(1e-9).ln();
    (cost, CoarseStart { tau_s, alternative_s: None, ln_scale, roll, shift, centre }, explained)
}
