//! Thresholds of the pixels by empirical Bayes.

use crate::diagnose::Evidence;
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::model::constants::CameraConstant;
use crate::diagnose::model::terms::train_blocks;
use crate::diagnose::model::view::ModelledPixel;
use rayon::prelude::*;
use std::sync::Arc;

/// Correlation of a pixel's ON and OFF threshold.
const CORRELATION: f64 = 0.5;
/// Largest finite difference of a log threshold; half of the threshold noise where that is less, so
/// that it lies within the peak.
const STEP: f64 = 0.02;

/// Mode and information of a pixel's two log thresholds from the training cells.
#[derive(Debug, Clone, Copy)]
struct PixelThresholds {
    mode: [f64; 2],
    information: [f64; 3],
}

fn train_score(
    evidence: &Evidence,
    model: &CameraModel,
    p: usize,
    spread: [f64; 2],
    view: &ModelledPixel<'_>,
) -> f64 {
    let mut one = model.clone();
    one.spread = Arc::new({
        let mut v = vec![[0.0; 2]; p + 1];
        v[p] = spread;
        v
    });
    let s = one.score(evidence, p, Some(view));
    let train = train_blocks(evidence, p);
    let events: f64 = s.events().filter(|(block, _)| train[*block]).map(|(_, l)| l).sum();
    let silence: f64 =
        s.compensator.iter().zip(&train).filter(|(_, train)| **train).map(|(c, _)| c).sum();
    events - silence
}

/// Quadratic approximation around the present thresholds.
fn quadratic(evidence: &Evidence, model: &CameraModel, p: usize) -> PixelThresholds {
    let at = model.spread[p];
    let view = model.view(evidence, p, None);
    let f = |dx: f64, dy: f64| train_score(evidence, model, p, [at[0] + dx, at[1] + dy], &view);
    let noise = model.constant(CameraConstant::LogNoise).exp();
    let (h, zero) = (STEP.min(0.5 * noise), f(0.0, 0.0));
    let (xp, xm, yp, ym) = (f(h, 0.0), f(-h, 0.0), f(0.0, h), f(0.0, -h));
    let pp = f(h, h);
    let g = [(xp - xm) / (2.0 * h), (yp - ym) / (2.0 * h)];
    let least = 1.0;
    let a = (-(xp - 2.0 * zero + xm) / (h * h)).max(least);
    let c = (-(yp - 2.0 * zero + ym) / (h * h)).max(least);
    let b = -(pp - xp - yp + zero) / (h * h);
    let limit = 0.9 * (a * c).sqrt();
    let b = b.clamp(-limit, limit);
    let det = a * c - b * b;
    let step = [(c * g[0] - b * g[1]) / det, (a * g[1] - b * g[0]) / det];
    // Newton's step from afar can lead away from the peak.
    let step = step.map(|s| s.clamp(-0.3, 0.3));
    let shares = [1.0, 0.5, 0.25, 0.125];
    let share = shares.into_iter().find(|s| f(s * step[0], s * step[1]) >= zero).unwrap_or(0.0);
    PixelThresholds {
        mode: [at[0] + share * step[0], at[1] + share * step[1]],
        information: [a, b, c],
    }
}

/// Thresholds about their mean over the pixels, which belongs to the camera's constants: an ON/OFF
/// ratio is no difference between pixels.
fn centred(mut pixels: Vec<PixelThresholds>) -> Vec<PixelThresholds> {
    for side in 0..2 {
        let weighed = pixels.iter().map(|p| [p.information[2 * side], p.mode[side]]);
        let [n, sum] = weighed.fold([0.0; 2], |[n, sum], [w, mode]| [n + w, sum + w * mode]);
        pixels.iter_mut().for_each(|pixel| pixel.mode[side] -= sum / n);
    }
    pixels
}

/// Log marginal likelihood of a spread.
fn marginal(pixels: &[PixelThresholds], sd: f64) -> f64 {
    pixels
        .iter()
        .map(|p| {
            let [a, b, c] = p.information;
            let det = a * c - b * b;
            let v = sd * sd;
            let (sa, sb, sc) = (c / det + v, -b / det + CORRELATION * v, a / det + v);
            let d = sa * sc - sb * sb;
            let [x, y] = p.mode;
            -0.5 * d.ln() - 0.5 * (sc * x * x - 2.0 * sb * x * y + sa * y * y) / d
        })
        .sum()
}

/// The model with the posterior means of the thresholds; the spread and its 90 % interval by the
/// marginal likelihood.
pub(crate) fn estimate(evidence: &Evidence, model: &CameraModel) -> (CameraModel, [f64; 3]) {
    let pixels = (0..evidence.pixels.len()).into_par_iter();
    let pixels = centred(pixels.map(|p| quadratic(evidence, model, p)).collect());
    let grid: Vec<f64> =
        (0..200).map(|i| 0.002 * 1.03_f64.powi(i)).take_while(|s| *s < 0.8).collect();
    let scores: Vec<f64> = grid.iter().map(|s| marginal(&pixels, *s)).collect();
    let best = (0..grid.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0);
    let inside: Vec<f64> =
        (0..grid.len()).filter(|i| scores[*i] > scores[best] - 1.353).map(|i| grid[i]).collect();
    let sd = grid[best].min(model.max_spread);
    let spread = pixels
        .iter()
        .map(|p| {
            // Posterior mean (J + P)^-1 J m, P the prior's precision.
            let v = sd * sd;
            let k = 1.0 / (v * (1.0 - CORRELATION * CORRELATION));
            let [a, b, c] = p.information;
            let (pa, pb) = (k, -CORRELATION * k);
            let (ma, mb, mc) = (a + pa, b + pb, c + pa);
            let r = [a * p.mode[0] + b * p.mode[1], b * p.mode[0] + c * p.mode[1]];
            let det = ma * mc - mb * mb;
            [(mc * r[0] - mb * r[1]) / det, (ma * r[1] - mb * r[0]) / det]
        })
        .collect();
    let mut other = model.clone();
    other.spread = Arc::new(spread);
    other.spread_sd = sd;
    (other, [grid[best], inside[0], *inside.last().unwrap_or(&grid[best])])
}
