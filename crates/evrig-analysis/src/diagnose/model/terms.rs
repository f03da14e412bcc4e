//! A pixel's terms of the log-likelihood under a model.

use crate::diagnose::Evidence;
use crate::diagnose::model::view::ModelledPixel;
use crate::predict::pass::{HazardTerm, TermVisitor, visit};

/// A pixel's terms of the log-likelihood.
#[derive(Debug, Clone)]
pub(crate) struct PixelTerms {
    /// Log hazard of each event, NaN where the signal is unknown, and its block.
    log_hazard: Vec<f64>,
    block: Vec<u16>,
    /// Compensator of each block.
    pub(crate) compensator: Vec<f64>,
}

impl PixelTerms {
    /// Number of events, scored or not.
    pub(crate) fn n_events(&self) -> usize {
        self.log_hazard.len()
    }

    /// Block and log hazard of each scored event.
    pub(crate) fn events(&self) -> impl Iterator<Item = (usize, f64)> {
        let all = self.block.iter().map(|b| usize::from(*b)).zip(self.log_hazard.iter().copied());
        all.filter(|(_, log_hazard)| log_hazard.is_finite())
    }

    /// Number, block and change of the log hazard against a base of each event scored in both.
    pub(crate) fn changes(&self, base: &Self) -> impl Iterator<Item = (usize, usize, f64)> {
        let pairs = self.log_hazard.iter().zip(&base.log_hazard).zip(&base.block);
        let all = pairs.enumerate().map(|(i, ((a, b), block))| (i, usize::from(*block), a - b));
        all.filter(|(.., change)| change.is_finite())
    }

    /// Change of the compensator of each training block against a base.
    pub(crate) fn compensator_changes(
        &self,
        base: &Self,
        is_train: &[bool],
    ) -> impl Iterator<Item = f64> {
        let pairs = self.compensator.iter().zip(&base.compensator).zip(is_train);
        pairs.filter(|(_, train)| **train).map(|((a, b), _)| a - b)
    }

    /// Derivatives of the log hazards of training events by a coordinate that was stepped, and of
    /// the training log-likelihood.
    pub(crate) fn derivative(&self, base: &Self, step: f64, is_train: &[bool]) -> (Vec<f64>, f64) {
        let mut row = vec![0.0; base.n_events()];
        let mut slope = 0.0;
        for (i, _, change) in self.changes(base).filter(|(_, block, _)| is_train[*block]) {
            row[i] = change / step;
            slope += row[i];
        }
        for change in self.compensator_changes(base, is_train) {
            slope -= change / step;
        }
        (row, slope)
    }
}

/// Whether each block of a pixel is in the training set.
pub(crate) fn train_blocks(evidence: &Evidence, p: usize) -> Vec<bool> {
    let tile = evidence.pixels[p].tile;
    (0..evidence.blocks.n()).map(|block| !evidence.is_held_out(tile, block)).collect()
}

struct TermCollector(PixelTerms);

impl TermVisitor for TermCollector {
    fn silence(&mut self, block: usize, compensator: f64) {
        self.0.compensator[block] += compensator;
    }
    fn event(&mut self, term: &HazardTerm) {
        self.0.log_hazard[term.index] = term.log_hazard;
        self.0.block[term.index] = term.block as u16;
    }
}

pub(crate) fn score_view(
    evidence: &Evidence,
    number: usize,
    view: &ModelledPixel<'_>,
) -> PixelTerms {
    let spikes = &evidence.pixels[number].spikes;
    let mut scorer = TermCollector(PixelTerms {
        log_hazard: vec![f64::NAN; spikes.len()],
        block: vec![0; spikes.len()],
        compensator: vec![0.0; evidence.blocks.n()],
    });
    visit(&view.law, view.sampled(), spikes, &evidence.blocks, &mut scorer);
    scorer.0
}
