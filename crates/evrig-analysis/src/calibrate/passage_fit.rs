//! k from whole passages: what the paper's regressions aim at, without their bias.
//!
//! A passage from one event to the next is a stopped motion: V - integral of the drift is a
//! martingale, so r = (+1 or -1) - integral of the drift over the passage has mean 0 whatever
//! the light did in between, and r^2 has the mean of the integral of the diffusion squared
//! (Wald's identities, exact at any noise). k solves sum z r = 0 and sum z' (r^2 - ...) = 0.
//! The weights z may depend on the light and on where the passage began, not on when it ended:
//! they are the derivatives at the end that the light foretells ([`super::along`]), which is
//! best where noise is small. Passages that might not end within the recording are left out
//! before their end is looked at.
//!
//! Stamps are whole microseconds: r^2 has a further (mu_start^2 + mu_end^2)/12, which is taken off.
//! Errors: sandwich, with tiles of pixels as clusters; they hold where the model does not, too,
//! in the sense that they tell how k would differ on other tiles of the same scene.

use super::along::{Along, Pixel};
use super::estimate::Constant;
use super::least_squares::{inverse, solve};
use super::passage::Passage;
use super::{CalibrateError, Light};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Rounds of foretelling and solving.
const N_ROUNDS: usize = 4;
/// Newton steps within a round.
const N_STEPS: usize = 2;
/// A floor of the variance in the weights, thresholds squared.
const LEAST_VARIANCE: f64 = 1e-8;

/// k from whole passages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassageFit {
    /// k1 to k6. An estimate may lie outside a constant's range when zero is within its error.
    pub k: [Constant; 6],
    /// Correlations of the errors of k1, k2, k4, k5, row by row.
    pub drift_correlation: [[f64; 4]; 4],
    /// Correlation of the errors of k3 and k6.
    pub diffusion_correlation: f64,
    /// Passages used.
    pub n_used: u64,
    /// Passages left out since they might not have ended within the recording.
    pub n_open: u64,
    /// Mean of r^2 over what the fit foretells; 1 when drift and noise are of this model.
    pub variance_ratio: f64,
    /// Share of passages with |r| above 1/2, where neither noise nor stamps can be the reason.
    pub share_far: f64,
}

/// A passage that is used, with what the light foretold.
struct Used {
    passage: Passage,
    tile: u32,
    foretold: Along,
}

/// Fits k to passages, starting from `start`.
pub(super) fn fit(
    light: &Light,
    passages: &[Passage],
    start: [f64; 6],
) -> Result<PassageFit, CalibrateError> {
    let lowest = lowest_dn(light);
    let mut k = start;
    k[1] = k[1].max(-0.5 * lowest);
    (k[2], k[5]) = (k[2].max(0.0), k[5].max(1e-7));
    let mut used = Vec::new();
    for _ in 0..N_ROUNDS {
        used = foretell(light, passages, &k);
        for _ in 0..N_STEPS {
            step_drift(light, &used, &mut k, lowest)?;
        }
        for _ in 0..N_STEPS {
            step_diffusion(light, &used, &mut k)?;
        }
    }
    result(light, &used, passages.len() as u64, &k)
}

fn lowest_dn(light: &Light) -> f64 {
    let lowest = |slot| light.series(slot).iter().copied().fold(f32::INFINITY, f32::min);
    f64::from((0..light.pixels().len()).map(lowest).fold(f32::INFINITY, f32::min))
}

fn pixel<'a>(light: &'a Light, passage: &Passage) -> Pixel<'a> {
    Pixel { times_us: light.times_us(), series: light.series(passage.slot as usize) }
}

fn foretell(light: &Light, passages: &[Passage], k: &[f64; 6]) -> Vec<Used> {
    let used = passages.par_iter().filter_map(|passage| {
        let foretold = pixel(light, passage).foretell(passage.start_us, k)?;
        let tile = light.tile(light.pixels()[passage.slot as usize]);
        Some(Used { passage: *passage, tile, foretold })
    });
    used.collect()
}

/// One passage's part in the equations: P weights, the residual, its derivatives.
struct Term<const P: usize> {
    tile: u32,
    weights: [f64; P],
    residual: f64,
    by: [f64; P],
}

fn drift_term(light: &Light, used: &Used, k: &[f64; 6]) -> Term<4> {
    let Used { passage, tile, foretold } = used;
    let along = pixel(light, passage).along(passage.start_us, passage.end_us, k[1]);
    let variance = foretold.variance(k) + rounding(light, passage, k) + LEAST_VARIANCE;
    Term {
        tile: *tile,
        weights: foretold.drift_by(k).map(|by| by / variance),
        residual: residual(light, passage, &along, k),
        by: along.drift_by(k),
    }
}

fn diffusion_term(light: &Light, used: &Used, k: &[f64; 6]) -> Term<2> {
    let Used { passage, tile, foretold } = used;
    let along = pixel(light, passage).along(passage.start_us, passage.end_us, k[1]);
    let rounding = rounding(light, passage, k);
    let variance = foretold.variance(k) + rounding + LEAST_VARIANCE;
    let r = residual(light, passage, &along, k);
    Term {
        tile: *tile,
        weights: foretold.variance_by(k).map(|by| by / (variance * variance)),
        residual: r * r - rounding - along.variance(k),
        by: along.variance_by(k),
    }
}

fn side(passage: &Passage) -> f64 {
    if passage.on { 1.0 } else { -1.0 }
}

/// The barrier met minus the drift up to it. A stamp is the end of the microsecond in which the
/// event came, so that on average both ends lie half a microsecond earlier.
fn residual(light: &Light, passage: &Passage, along: &Along, k: &[f64; 6]) -> f64 {
    let pixel = pixel(light, passage);
    let [start, end] = [passage.start_us, passage.end_us].map(|t| pixel.drift_at(t, k));
    side(passage) - along.drift(k) + 0.5 * (end - start)
}

/// Variance that stamps in whole microseconds add to r.
fn rounding(light: &Light, passage: &Passage, k: &[f64; 6]) -> f64 {
    let pixel = pixel(light, passage);
    let [start, end] = [passage.start_us, passage.end_us].map(|t| pixel.drift_at(t, k));
    (start * start + end * end) / 12.0
}

/// Sums of terms by tile; tiles in a fixed order, so that threads do not change the sum.
struct Equations<const P: usize> {
    /// sum z (dr/dk)', thresholds.
    matrix: DMatrix<f64>,
    /// sum z r of every tile.
    scores: Vec<DVector<f64>>,
}

fn equations<const P: usize>(
    used: &[Used],
    term: impl Fn(&Used) -> Term<P> + Sync,
) -> Equations<P> {
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
    Equations { matrix, scores: scores.into_values().collect() }
}

impl<const P: usize> Equations<P> {
    fn step(&self) -> Option<DVector<f64>> {
        let sum = self.scores.iter().fold(DVector::zeros(P), |sum, score| sum + score);
        solve(&self.matrix, &sum)
    }

    /// Covariance of the solution: A^-1 (sum of squared scores) A^-T, for few tiles enlarged by
    /// G / (G - P).
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
    light: &Light,
    used: &[Used],
    k: &mut [f64; 6],
    lowest_dn: f64,
) -> Result<(), CalibrateError> {
    let equations = equations(used, |used| drift_term(light, used, k));
    let step = equations.step().ok_or_else(|| undetermined("k1, k2, k4, k5", used.len()))?;
    // A k2 near minus the darkest brightness has no gain there; half way is as far as it goes.
    let k2 = (k[1] + step[1]).max(-0.5 * lowest_dn);
    *k = [k[0] + step[0], k2, k[2], k[3] + step[2], k[4] + step[3], k[5]];
    if k.iter().all(|k| k.is_finite()) { Ok(()) } else { Err(undetermined("k", used.len())) }
}

fn step_diffusion(light: &Light, used: &[Used], k: &mut [f64; 6]) -> Result<(), CalibrateError> {
    let equations = equations(used, |used| diffusion_term(light, used, k));
    let step = equations.step().ok_or_else(|| undetermined("k3, k6", used.len()))?;
    // Far from the solution the square bends: at most a doubling a step.
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
    light: &Light,
    used: &[Used],
    n_passages: u64,
    k: &[f64; 6],
) -> Result<PassageFit, CalibrateError> {
    let drift = equations(used, |used| drift_term(light, used, k));
    let diffusion = equations(used, |used| diffusion_term(light, used, k));
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
            let term = drift_term(light, used, k);
            let foretold = used.foretold.variance(k) + rounding(light, &used.passage, k);
            (term.residual, foretold)
        })
        .collect();
    let n_far = residuals.iter().filter(|(r, _)| r.abs() > 0.5).count() as f64;
    let (squares, foretold) =
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
        variance_ratio: squares / foretold,
        share_far: n_far / n.max(1) as f64,
    })
}
