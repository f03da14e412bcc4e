//! Standard errors by the sandwich estimate, clustered by tile and by block.

use crate::diagnose::Evidence;
use crate::diagnose::fit::optimizer::{ModelFit, stepped};
use crate::diagnose::model::terms::{PixelTerms, score_view};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Standard error of each coordinate of a fit; 0 for those that were not fitted, infinite for those
/// at the end of their range.
///
/// Scores are summed over tiles and over blocks of the training cells (Cameron, Gelbach and Miller,
/// 2011), so that errors of the signal common to neighbours count once.
pub(crate) fn standard_errors(evidence: &Evidence, fit: &ModelFit) -> Vec<f64> {
    let mut errors = vec![0.0; fit.model.values.len()];
    let Some(covariance) = &fit.covariance else { return errors };
    let k = fit.active.len();
    let n_blocks = evidence.blocks.n();
    let of_pixels: Vec<Vec<DVector<f64>>> = (0..evidence.pixels.len())
        .into_par_iter()
        .map(|p| block_scores(evidence, fit, p))
        .collect();
    let mut meat = DMatrix::zeros(k, k);
    let mut add = |n: usize, sign: f64, cluster: &dyn Fn(usize, usize) -> usize| {
        let mut sums = vec![DVector::zeros(k); n];
        for (pixel, scores) in evidence.pixels.iter().zip(&of_pixels) {
            for (block, score) in scores.iter().enumerate() {
                sums[cluster(pixel.tile, block)] += score;
            }
        }
        sums.iter().for_each(|s| meat += s * s.transpose() * sign);
    };
    add(evidence.n_tiles, 1.0, &|tile, _| tile);
    add(n_blocks, 1.0, &|_, block| block);
    add(evidence.n_tiles * n_blocks, -1.0, &|tile, block| tile * n_blocks + block);
    let sandwich = covariance * &meat * covariance;
    for (j, &at) in fit.active.iter().enumerate() {
        // The two-way estimate is not positive in every finite sample; the information bounds it.
        let variance = sandwich[(j, j)].max(covariance[(j, j)].abs());
        // The end of a range holds a coordinate without information.
        errors[at] = if variance > 0.0 { variance.sqrt() } else { f64::INFINITY };
    }
    errors
}

/// Scores of a pixel's training blocks by forward differences.
fn block_scores(evidence: &Evidence, fit: &ModelFit, p: usize) -> Vec<DVector<f64>> {
    let coordinates = fit.model.coordinates(evidence);
    let view = fit.model.view(evidence, p, None);
    let base = block_sums(evidence, p, &score_view(evidence, p, &view));
    let mut scores = vec![DVector::zeros(fit.active.len()); base.len()];
    for (j, &at) in fit.active.iter().enumerate() {
        let (moved, h) = stepped(evidence, &fit.model, (at, &coordinates[at]), p, &view);
        for (b, sum) in block_sums(evidence, p, &moved).into_iter().enumerate() {
            scores[b][j] = (sum - base[b]) / h;
        }
    }
    scores
}

/// Log-likelihood of each training block.
fn block_sums(evidence: &Evidence, p: usize, terms: &PixelTerms) -> Vec<f64> {
    let mut sums: Vec<f64> = terms.compensator.iter().map(|c| -c).collect();
    for (block, log_hazard) in terms.events() {
        sums[block] += log_hazard;
    }
    let tile = evidence.pixels[p].tile;
    for (block, sum) in sums.iter_mut().enumerate() {
        if evidence.is_held_out(tile, block) {
            *sum = 0.0;
        }
    }
    sums
}
