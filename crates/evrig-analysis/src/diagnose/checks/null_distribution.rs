//! Null distribution of the search.
//!
//! Recordings simulated from the fitted model, on the same pixels and signal, pass through the
//! same fits: the library's gains there are chance and selection bias.

use super::two_sample_test::test_structure;
use crate::diagnose::fit::effect_scan::scan_library;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::fit::gauss_newton::fit;
use crate::diagnose::{Evidence, Hypothesis};
use crate::predict::{Spike, sample};
use evrig_core::stats::SplitMix;
use rayon::prelude::*;

/// A simulated recording of a hypothesis.
pub(crate) fn draw_recording(evidence: &Evidence, hypothesis: &Hypothesis, seed: u64) -> Evidence {
    let mixture = hypothesis.pixel_mixture().tabulated();
    let spikes: Vec<Vec<Spike>> = evidence
        .pixels
        .par_iter()
        .enumerate()
        .map(|(number, pixel)| {
            let mut random = SplitMix::new(seed, number as u64);
            let stratum = mixture.draw(random.uniform());
            let view = hypothesis.view(evidence, pixel, stratum, Vec::new());
            sample(&view.law, view.light(), evidence.blocks.length_us(), &mut random)
        })
        .collect();
    evidence.with_events(spikes)
}

/// Results on simulated recordings, one value each.
pub(crate) struct NullDraws {
    /// Largest held-out gain of any effect.
    pub(crate) gains: Vec<f64>,
    /// Residual structure, nats per event.
    pub(crate) structures: Vec<f64>,
}

/// Simulates `n` recordings and applies the same fits.
pub(crate) fn null_draws(
    evidence: &Evidence,
    few: &Evidence,
    model: &FittedModel,
    n: usize,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> NullDraws {
    let every = evidence.pixels.len().div_ceil(few.pixels.len().max(1)).max(1);
    let mut found = NullDraws { gains: Vec::new(), structures: Vec::new() };
    for number in 0..n as u64 {
        let own_seed = seed.wrapping_add(1 + number);
        let drawn = draw_recording(evidence, &model.hypothesis, own_seed);
        let refitted = fit(&drawn, model.hypothesis.clone(), 3, 1e-4);
        let left = test_structure(&drawn, &refitted, own_seed);
        found.structures.extend(left.map(|left| left.nats));
        let tried = scan_library(&drawn, &drawn.thinned(every), &refitted, progress);
        found.gains.push(tried.iter().map(|tried| tried.gain.held_out).fold(0.0, f64::max));
    }
    found
}
