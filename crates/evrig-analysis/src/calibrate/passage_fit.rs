//! Unbiased estimating equations for k over whole passages between events.
//!
//! A passage from one event to the next is a stopped diffusion: V - integral of the drift is a
//! martingale, so r = (+1 or -1) - integral of the drift over the passage has mean 0 for any
//! brightness in between, and r^2 has the mean of the integral of the diffusion squared
//! (Wald's identities, exact at any noise). k solves sum z r = 0 and sum z' (r^2 - ...) = 0.
//! The weights z may depend on the brightness and on the start of the passage, not on its end: they
//! are the derivatives at the expected end ([`super::path_integrals`]), which is optimal for small
//! noise. Passages that might not end within the recording are left out without using their end.
//!
//! Stamps are whole microseconds, which adds (mu_start^2 + mu_end^2)/12 to r^2; it is subtracted.
//! Errors: sandwich estimator with tiles of pixels as clusters. Under misspecification they still
//! describe how k varies between tiles of the scene.

use super::estimate::Constant;
use super::least_squares::{inverse, solve};
use super::passage::Passage;
use super::path_integrals::{PathIntegrals, PixelBrightness};
use super::{BrightnessSeries, CalibrateError};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Rounds of prediction and solution.
const N_ROUNDS: usize = 4;
/// Newton steps within a round.
const N_STEPS: usize = 2;
/// Floor of the variance in the weights, thresholds squared.
const MIN_VARIANCE: f64 = 1e-8;

/// Estimates of k from whole passages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassageFit {
    /// k1 to k6. An estimate may lie outside its constant's range by less than its error.
    pub k: [Constant; 6],
    /// Correlations of the errors of k1, k2, k4, k5, row by row.
    pub drift_correlation: [[f64; 4]; 4],
    /// Correlation of the errors of k3 and k6.
    pub diffusion_correlation: f64,
    /// Passages used.
    pub n_used: u64,
    /// Passages left out because they might not have ended within the recording.
    pub n_open: u64,
    /// Mean of r^2 over its value predicted by the fit; 1 when drift and noise are of this model.
    pub variance_ratio: f64,
    /// Share of passages with |r| above 1/2, more than noise and stamps can explain.
    pub share_far: f64,
}

/// A passage with its predicted integrals.
struct PredictedPassage {
    passage: Passage,
    tile: u32,
    predicted: PathIntegrals,
}

/// Fits k to passages, starting from `start`.
pub(super) fn fit(
    brightness: &BrightnessSeries,
    passages: &[Passage],
    start: [f64; 6],
) -> Result<PassageFit, CalibrateError> {
    let lowest = lowest_dn(brightness);
    let mut k = start;
    k[1] = k[1].max(-0.5 * lowest);
    (k[2], k[5]) = (k[2].max(0.0), k[5].max(1e-7));
    let mut used = Vec::new();
    for _ in 0..N_ROUNDS {
        used = predict(brightness, passages, &k);
        for _ in 0..N_STEPS {
            step_drift(brightness, &used, &mut k, lowest)?;
        }
        for _ in 0..N_STEPS {
            step_diffusion(brightness, &used, &mut k)?;
        }
    }
    result(brightness, &used, passages.len() as u64, &k)
}

fn lowest_dn(brightness: &BrightnessSeries) -> f64 {
    let lowest = |slot| brightness.series(slot).iter().copied().fold(f32::INFINITY, f32::min);
    f64::from((0..brightness.pixels().len()).map(lowest).fold(f32::INFINITY, f32::min))
}

fn pixel<'a>(brightness: &'a BrightnessSeries, passage: &Passage) -> PixelBrightness<'a> {
    PixelBrightness {
        times_us: brightness.times_us(),
        series: brightness.series(passage.slot as usize),
    }
}

fn predict(
    brightness: &BrightnessSeries,
    passages: &[Passage],
    k: &[f64; 6],
) -> Vec<PredictedPassage> {
    let used = passages.par_iter().filter_map(|passage| {
        let predicted = pixel(brightness, passage).predict(passage.start_us, k)?;
        let tile = brightness.tile(brightness.pixels()[passage.slot as usize]);
        Some(PredictedPassage { passage: *passage, tile, predicted })
    });
    used.collect()
}

/// One passage's contribution: P weights, the residual and its derivatives.
struct Term<const P: usize> {
    tile: u32,
    weights: [f64; P],
    residual: f64,
    by: [f64; P],
}

fn drift_term(brightness: &BrightnessSeries, used: &PredictedPassage, k: &[f64; 6]) -> Term<4> {
    let PredictedPassage { passage, tile, predicted } = used;
    let PassageResidual { along, value, rounding } = residual(brightness, passage, k);
    let variance = predicted.variance(k) + rounding + MIN_VARIANCE;
    Term {
        tile: *tile,
        weights: predicted.drift_by(k).map(|by| by / variance),
        residual: value,
        by: along.drift_by(k),
    }
}

fn diffusion_term(brightness: &BrightnessSeries, used: &PredictedPassage, k: &[f64; 6]) -> Term<2> {
    let PredictedPassage { passage, tile, predicted } = used;
    let PassageResidual { along, value: r, rounding } = residual(brightness, passage, k);
    let variance = predicted.variance(k) + rounding + MIN_VARIANCE;
    Term {
        tile: *tile,
        weights: predicted.variance_by(k).map(|by| by / (variance * variance)),
        residual: r * r - rounding - along.variance(k),
        by: along.variance_by(k),
    }
}

/// Barrier minus drift along a passage.
struct PassageResidual {
    along: PathIntegrals,
    /// Thresholds.
    value: f64,
    /// Variance of it by rounding of the stamps.
    rounding: f64,
}

/// Stamps are rounded up, so both ends lie half a microsecond earlier on average.
fn residual(brightness: &BrightnessSeries, passage: &Passage, k: &[f64; 6]) -> PassageResidual {
    let pixel = pixel(brightness, passage);
    let along = pixel.along(passage.start_us, passage.end_us, k[1]);
    let [start, end] = [passage.start_us, passage.end_us].map(|t| pixel.drift_at(t, k));
    let side = if passage.on { 1.0 } else { -1.0 };
    PassageResidual {
        value: side - along.drift(k) + 0.5 * (end - start),
        rounding: (start * start + end * end) / 12.0,
        along,
    }
}

/// Sums of terms by tile, in a fixed order for reproducibility.
struct EstimatingEquations<const P: usize> {
    /// sum z (dr/dk)', thresholds.
    matrix: DMatrix<f64>,
    /// sum z r of every tile.
    scores: Vec<DVector<f64>>,
}

fn equations<const P: usize>(
    used: &[PredictedPassage],
    term: impl Fn(&PredictedPassage) -> Term<P> + Sync,
) -> EstimatingEquations<P> {
    const CHUNK: usize = 4096;
    type ByTile<const P: usize> = std::collections::BTreeMap<u32, [f64; P]>;
    let parts: Vec<(DMatrix<f64>, ByTile<P>)> = used
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut matrix = DMatrix::zeros(P, P);
            let mut scores = std::collections::BTreeMap::new();
            for term in chunk.iter().map(&term) {
                let score = scores.entry(term.tile).or_insert([0.0; P]);
                for i in 0..P {
                    score[i] += term.weights[i] * term.residual;
                    for j in 0..P {
                        matrix[(i, j)] += term.weights[i] * term.by[j];
                    }
                }
            }
            (matrix, scores)
        })
        .collect();
    let mut matrix = DMatrix::zeros(P, P);
    let mut scores = std::collections::BTreeMap::<u32, DVector<f64>>::new();
    for (part, by_tile) in parts {
        matrix += part;
        for (tile, score) in by_tile {
            let sum = scores.entry(tile).or_insert_with(|| DVector::zeros(P));
            *sum += DVector::from_row_slice(&score);
        }
    }
    EstimatingEquations { matrix, scores: scores.into_values().collect() }
}

impl<const P: usize> EstimatingEquations<P> {
    fn step(&self) -> Option<DVector<f64>> {
        let sum = self.scores.iter().fold(DVector::zeros(P), |sum, score| sum + score);
        solve(&self.matrix, &sum)
    }

    /// Sandwich covariance A^-1 (sum of squared scores) A^-T, with the correction G / (G - P).
    fn covariance(&self) -> Option<DMatrix<f64>> {
        let inverse = inverse(&self.matrix)?;
        let mut meat = DMatrix::zeros(P, P);
        for score in &self.scores {
            meat += score * score.transpose();
        }
        let tiles = self.scores.len() as f64;
        Some(&inverse * meat * inverse.transpose() * (tiles / (tiles - P as f64).max(1.0)))
    }
}

fn step_drift(
    brightness: &BrightnessSeries,
    used: &[PredictedPassage],
    k: &mut [f64; 6],
    lowest_dn: f64,
) -> Result<(), CalibrateError> {
    let equations = equations(used, |used| drift_term(brightness, used, k));
    let step = equations.step().ok_or_else(|| undetermined("k1, k2, k4, k5", used.len()))?;
    // The gain is infinite at k2 = -(lowest brightness).
    let k2 = (k[1] + step[1]).max(-0.5 * lowest_dn);
    *k = [k[0] + step[0], k2, k[2], k[3] + step[2], k[4] + step[3], k[5]];
    if k.iter().all(|k| k.is_finite()) { Ok(()) } else { Err(undetermined("k", used.len())) }
}

fn step_diffusion(
    brightness: &BrightnessSeries,
    used: &[PredictedPassage],
    k: &mut [f64; 6],
) -> Result<(), CalibrateError> {
    let equations = equations(used, |used| diffusion_term(brightness, used, k));
    let step = equations.step().ok_or_else(|| undetermined("k3, k6", used.len()))?;
    // The equation is quadratic: at most a doubling per step.
    let bound = |k: f64, step: f64, other: f64| {
        let most = k.abs().max(0.1 * other.abs()).max(1e-8);
        k + step.clamp(-most, most)
    };
    (k[2], k[5]) = (bound(k[2], step[0], 10.0 * k[5]), bound(k[5], step[1], 0.1 * k[2]));
    Ok(())
}

fn undetermined(which: &'static str, n_passages: usize) -> CalibrateError {
    CalibrateError::Undetermined { which, n_passages }
}

fn result(
    brightness: &BrightnessSeries,
    used: &[PredictedPassage],
    n_passages: u64,
    k: &[f64; 6],
) -> Result<PassageFit, CalibrateError> {
    let drift = equations(used, |used| drift_term(brightness, used, k));
    let diffusion = equations(used, |used| diffusion_term(brightness, used, k));
    let n = used.len() as u64;
    let of_drift = drift.covariance().ok_or_else(|| undetermined("k1, k2, k4, k5", used.len()))?;
    let of_diffusion = diffusion.covariance().ok_or_else(|| undetermined("k3, k6", used.len()))?;
    let tiles = drift.scores.len() as f64;
    let constant = |value: f64, covariance: &DMatrix<f64>, i: usize| {
        let freedom = tiles - covariance.nrows() as f64;
        Constant::new(value, covariance[(i, i)].max(0.0).sqrt(), freedom, n)
    };
    let correlation = |covariance: &DMatrix<f64>, i: usize, j: usize| {
        covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt()
    };
    let residuals: Vec<(f64, f64)> = used
        .par_iter()
        .map(|used| {
            let PassageResidual { value, rounding, .. } = residual(brightness, &used.passage, k);
            (value, used.predicted.variance(k) + rounding)
        })
        .collect();
    let n_far = residuals.iter().filter(|(r, _)| r.abs() > 0.5).count() as f64;
    let (squares, predicted) =
        residuals.iter().fold((0.0, 0.0), |(a, b), (r, f)| (a + r * r, b + f));
    Ok(PassageFit {
        k: [
            constant(k[0], &of_drift, 0),
            constant(k[1], &of_drift, 1),
            constant(k[2], &of_diffusion, 0),
            constant(k[3], &of_drift, 2),
            constant(k[4], &of_drift, 3),
            constant(k[5], &of_diffusion, 1),
        ],
        drift_correlation: std::array::from_fn(|i| {
            std::array::from_fn(|j| correlation(&of_drift, i, j))
        }),
        diffusion_correlation: correlation(&of_diffusion, 0, 1),
        n_used: n,
        n_open: n_passages - n,
        variance_ratio: squares / predicted,
        share_far: n_far / n.max(1) as f64,
    })
}
