//! What the search finds where there is nothing to find.
//!
//! Events are drawn from the fitted model itself, on the same pixels under the same light, and go
//! through the same fits: what the library buys there is chance and the search's own bias.

use super::two_sample_test::structure;
use crate::diagnose::fit::effect_scan::scan;
use crate::diagnose::fit::fitted::Fitted;
use crate::diagnose::fit::gauss_newton::fit;
use crate::diagnose::{Evidence, Hypothesis};
use crate::predict::{Spike, sample};
use evrig_core::stats::SplitMix;
use rayon::prelude::*;

/// Draws the events of every pixel from a hypothesis.
pub(crate) fn draw(evidence: &Evidence, hypothesis: &Hypothesis, seed: u64) -> Evidence {
    let kinds = hypothesis.kinds().tabled();
    let spikes: Vec<Vec<Spike>> = evidence
        .pixels
        .par_iter()
        .enumerate()
        .map(|(number, pixel)| {
            let mut random = SplitMix::new(seed, number as u64);
            let kind = kinds.drawn(random.uniform());
            let view = hypothesis.view(evidence, pixel, kind, Vec::new());
            sample(&view.law, view.light(), evidence.blocks.length_us(), &mut random)
        })
        .collect();
    evidence.with_spikes(spikes)
}

/// What recordings drawn from a model show, one value a recording.
pub(crate) struct Drawn {
    /// The greatest held-out gain of any effect.
    pub(crate) gains: Vec<f64>,
    /// The structure that the model leaves in what was drawn from it, nats an event.
    pub(crate) structures: Vec<f64>,
}

/// Draws `n` recordings from the model and puts them through the same fits.
pub(crate) fn drawn(
    evidence: &Evidence,
    few: &Evidence,
    model: &Fitted,
    n: usize,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Drawn {
    let every = evidence.pixels.len().div_ceil(few.pixels.len().max(1)).max(1);
    let mut found = Drawn { gains: Vec::new(), structures: Vec::new() };
    for number in 0..n as u64 {
        let own_seed = seed.wrapping_add(1 + number);
        let drawn = draw(evidence, &model.hypothesis, own_seed);
        let refitted = fit(&drawn, model.hypothesis.clone(), 3, 1e-4);
        let left = structure(&drawn, &refitted, own_seed);
        found.structures.extend(left.map(|left| left.nats));
        let tried = scan(&drawn, &drawn.thinned(every), &refitted, progress);
        found.gains.push(tried.iter().map(|tried| tried.gain.held_out).fold(0.0, f64::max));
    }
    found
}
