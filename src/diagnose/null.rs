//! What the search finds where there is nothing to find.
//!
//! Events are drawn from the fitted model itself, on the same pixels under the same light, and go
//! through the same fits: what the library buys there is chance and the search's own bias.

use super::fit::{Fitted, fit};
use super::scan::scan;
use super::{Evidence, Hypothesis};
use crate::predict::{Spike, sample};
use crate::stats::SplitMix;
use rayon::prelude::*;

/// Draws the events of every pixel from a hypothesis.
pub(super) fn draw(evidence: &Evidence, hypothesis: &Hypothesis, seed: u64) -> Evidence {
    let kinds = hypothesis.kinds();
    let spikes: Vec<Vec<Spike>> = evidence
        .pixels
        .par_iter()
        .enumerate()
        .map(|(number, pixel)| {
            let mut random = SplitMix::new(seed, number as u64);
            let mut rest = random.uniform();
            let mut kind = kinds.first().map_or(0.0, |k| k.1);
            for (share, value) in &kinds {
                kind = *value;
                rest -= share;
                if rest <= 0.0 {
                    break;
                }
            }
            let view = hypothesis.view(evidence, pixel, kind, Vec::new());
            sample(&view.law, view.light(), evidence.blocks.length_us(), &mut random)
        })
        .collect();
    evidence.with_spikes(spikes)
}

/// The greatest held-out gain of any effect in each of `n` recordings drawn from the model.
pub(super) fn greatest_gains(
    evidence: &Evidence,
    model: &Fitted,
    n: usize,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Vec<f64> {
    (0..n as u64)
        .map(|number| {
            let drawn = draw(evidence, &model.hypothesis, seed.wrapping_add(1 + number));
            let few = drawn.thinned(2);
            let refitted = fit(&drawn, model.hypothesis.clone(), 4, 1e-4);
            let tried = scan(&drawn, &few, &refitted, progress);
            tried.first().map_or(0.0, |best| best.gain.held_out.max(0.0))
        })
        .collect()
}
