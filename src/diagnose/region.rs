//! Is an effect limited to a part of the sensor?
//!
//! An effect that is in one part only is fitted too weak over all, and costs where it is not. The
//! rectangle of tiles whose pixels gain most by it is then smaller than the sensor, and the effect
//! refitted in that rectangle alone buys more on held-out cells.

use super::Evidence;
use super::fit::{Fitted, fit};
use super::score::Part;
use crate::geometry::Rectangle;

/// Share of the events that has to lie outside for a part to be one.
const LEAST_OUTSIDE: f64 = 0.12;

/// A region has to buy this much more than the effect everywhere, nats an event.
const LEAST_GAIN: f64 = 0.02;

/// And so many standard errors.
const LEAST_ERRORS: f64 = 4.0;

/// The model with its last effect limited to a region, where that is better.
pub(super) fn limited(evidence: &Evidence, without: &Fitted, model: &Fitted) -> Option<Fitted> {
    let last = model.hypothesis.effects.len().checked_sub(1)?;
    let effect = model.hypothesis.effects[last];
    if !effect.frees.is_empty() || effect.mixture.is_some() {
        return None;
    }
    let region = best_rectangle(evidence, without, model)?;
    let (outside, all) = evidence.pixels.iter().fold((0, 0), |(outside, all), pixel| {
        let n = pixel.spikes.len();
        (outside + if region.contains(pixel.x, pixel.y) { 0 } else { n }, all + n)
    });
    if (outside as f64) < LEAST_OUTSIDE * all as f64 {
        return None;
    }
    let mut hypothesis = model.hypothesis.clone();
    hypothesis.regions[last] = Some(region);
    let limited = fit(evidence, hypothesis, 10, 1e-5);
    let (gain, error) = limited.cells.gain(&model.cells, Part::HeldOut);
    (gain > LEAST_GAIN && gain > LEAST_ERRORS * error).then_some(limited)
}

/// The rectangle of tiles over which the training cells gain most (Bentley, Comm. ACM 27, 1984).
fn best_rectangle(evidence: &Evidence, without: &Fitted, model: &Fitted) -> Option<Rectangle> {
    let [n_across, n_down] = evidence.tiles;
    let n_blocks = evidence.blocks.n();
    let mut gains = vec![0.0; n_across * n_down];
    for cell in model.cells.of(Part::Training) {
        let gain = model.cells.log_likelihood[cell] - without.cells.log_likelihood[cell];
        gains[cell / n_blocks] += gain;
    }
    let mut best = (0.0, [0, 0, 0, 0]);
    for top in 0..n_down {
        let mut columns = vec![0.0; n_across];
        for bottom in top..n_down {
            for (x, column) in columns.iter_mut().enumerate() {
                *column += gains[bottom * n_across + x];
            }
            let (mut sum, mut left) = (0.0, 0);
            for (x, column) in columns.iter().enumerate() {
                if sum <= 0.0 {
                    (sum, left) = (0.0, x);
                }
                sum += column;
                if sum > best.0 {
                    best = (sum, [left, x + 1, top, bottom + 1]);
                }
            }
        }
    }
    let [left, right, top, bottom] = best.1;
    let tile = usize::from(evidence.tile_px);
    let size = [2.0 * evidence.middle[0], 2.0 * evidence.middle[1]];
    let end = |tiles: usize, size: f64| ((tiles * tile) as f64).min(size) as u16;
    (best.0 > 0.0).then(|| Rectangle {
        x_px: [end(left, size[0]), end(right, size[0])],
        y_px: [end(top, size[1]), end(bottom, size[1])],
    })
}
