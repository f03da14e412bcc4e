//! Goodness of fit: time rescaling and a classifier two-sample test.

use crate::diagnose::fit::optimizer::ModelFit;
use crate::diagnose::levels::{
    DOUBT_STANDARD_ERRORS, NEGLIGIBLE_NATS_PER_EVENT, SIGNIFICANT_STANDARD_ERRORS,
};
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::report::heat_map::ModelResiduals;
use crate::diagnose::test::event_strata::{LocatedResidual, misfit_strata};
use crate::diagnose::test::two_sample_test::{NEXT_EVENT_STREAM, StructureTest, test_structure};
use crate::diagnose::test::upper_bound::{RecalibrationGain, recalibration_gain};
use crate::diagnose::{Evidence, MisfitStratum};
use crate::predict::pass::{HazardTerm, PixelPass, TermVisitor, visit};
use crate::predict::{NextEventPair, PreviousEvent, Residual, SpikeContext};
use evrig_core::stats::SplitMix;
use rayon::prelude::*;

/// Goodness of fit of a model.
#[derive(Debug, Clone)]
pub(crate) struct GoodnessOfFit {
    residuals: Vec<LocatedResidual>,
    pub(crate) by_pixel: ModelResiduals,
    pub(crate) recalibration: RecalibrationGain,
    pub(crate) structure: Option<StructureTest>,
}

impl GoodnessOfFit {
    pub(crate) fn of(evidence: &Evidence, fit: &ModelFit, seed: u64) -> Self {
        let (of_pixels, counts): (Vec<Vec<LocatedResidual>>, Vec<Vec<[f64; 2]>>) =
            residuals_of(evidence, &fit.model).into_iter().unzip();
        let plain =
            of_pixels.iter().map(|own| own.iter().map(|located| located.residual).collect());
        let by_pixel = plain.zip(counts).collect();
        let residuals: Vec<LocatedResidual> = of_pixels.into_iter().flatten().collect();
        let recalibration = recalibration_gain(evidence, &residuals);
        let structure =
            test_structure(evidence, |number| next_events(evidence, &fit.model, number, seed));
        Self { residuals, by_pixel, recalibration, structure }
    }

    /// The larger of two significant misfits, nats per event: by the time-rescaled intervals and by
    /// the classifier.
    pub(crate) fn misfit(&self) -> f64 {
        let significant = |gain: f64, error: f64| {
            if gain > SIGNIFICANT_STANDARD_ERRORS * error { gain } else { 0.0 }
        };
        let rescaled = significant(self.recalibration.gain, self.recalibration.error);
        let classified = self.structure.as_ref().map_or(0.0, |s| significant(s.nats, s.error));
        rescaled.max(classified)
    }

    /// Whether one of the tests doubts the model, so that a search for effects is worth its work.
    pub(crate) fn is_doubted(&self) -> bool {
        let doubted = |gain: f64, error: f64| gain > DOUBT_STANDARD_ERRORS * error;
        doubted(self.recalibration.gain, self.recalibration.error)
            || self.structure.as_ref().is_some_and(|s| doubted(s.nats, s.error))
    }

    pub(crate) fn strata(&self) -> Vec<MisfitStratum> {
        let least = NEGLIGIBLE_NATS_PER_EVENT / 4.0;
        with_structure(misfit_strata(&self.residuals, least), self.structure.as_ref(), least)
    }
}

/// Adds ranges of the two-sample test to strata of the recalibration.
fn with_structure(
    mut places: Vec<MisfitStratum>,
    left: Option<&StructureTest>,
    least: f64,
) -> Vec<MisfitStratum> {
    let around = left.into_iter().flat_map(|left| left.misfit_ranges.iter().cloned());
    places.extend(around.filter(|place| place.excess_nats_per_event > least));
    places
}

struct ResidualCollector<'a> {
    evidence: &'a Evidence,
    number: usize,
    found: Vec<LocatedResidual>,
    /// Recorded and expected events per block.
    counts: Vec<[f64; 2]>,
}

impl TermVisitor for ResidualCollector<'_> {
    fn silence(&mut self, block: usize, compensator: f64) {
        self.counts[block][1] += compensator;
    }

    fn event(&mut self, term: &HazardTerm) {
        self.counts[term.block][0] += 1.0;
        let pixel = &self.evidence.pixels[self.number];
        let previous = term.index.checked_sub(1).map(|i| pixel.spikes[i]).map(|before| {
            PreviousEvent { ago_s: (term.spike.t_us - before.t_us) as f64 * 1e-6, on: before.on }
        });
        self.found.push(LocatedResidual {
            residual: Residual {
                x: pixel.x,
                y: pixel.y,
                t_us: term.spike.t_us,
                on: term.spike.on,
                innovation: Some(term.change - 1.0),
                log_hazard: term.log_hazard,
                background_share: term.background_share,
                compensator: term.compensator,
                slope_per_s: term.slope_per_s,
                level: term.level,
                previous,
            },
            cell: self.evidence.cell(pixel, term.block),
            held_out: self.evidence.is_held_out(pixel.tile, term.block),
        });
    }
}

/// Residuals and counts of each pixel.
fn residuals_of(
    evidence: &Evidence,
    model: &CameraModel,
) -> Vec<(Vec<LocatedResidual>, Vec<[f64; 2]>)> {
    let of_pixel = |number: usize| {
        let view = model.view(evidence, number, None);
        let counts = vec![[0.0; 2]; evidence.blocks.n()];
        let mut collector = ResidualCollector { evidence, number, found: Vec::new(), counts };
        let spikes = &evidence.pixels[number].spikes;
        visit(&view.law, view.sampled(), spikes, &evidence.blocks, &mut collector);
        (collector.found, collector.counts)
    };
    (0..evidence.pixels.len()).into_par_iter().map(of_pixel).collect()
}

/// Draws an event after each recorded one.
struct NextEvents {
    pairs: Vec<NextEventPair>,
    random: SplitMix,
    end_us: f64,
    theta: [f64; 2],
}

impl TermVisitor for NextEvents {
    fn silence(&mut self, _block: usize, _compensator: f64) {}

    fn event(&mut self, term: &HazardTerm) {
        if let Some(last) = self.pairs.last_mut().filter(|pair| pair.before + 1 == term.index) {
            last.real = Some(SpikeContext {
                spike: term.spike,
                change: term.change * self.theta[usize::from(!term.spike.on)],
                slope_per_s: term.slope_per_s,
                level: term.level,
            });
        }
    }

    fn after(&mut self, pass: &PixelPass<'_>, index: usize) {
        let drawn = pass.draw_next(self.end_us, &mut self.random).map(|drawn| SpikeContext {
            spike: drawn.spike,
            change: drawn.change * self.theta[usize::from(!drawn.spike.on)],
            slope_per_s: drawn.slope_per_s,
            level: drawn.level,
        });
        self.pairs.push(NextEventPair { before: index, real: None, drawn });
    }
}

fn next_events(
    evidence: &Evidence,
    model: &CameraModel,
    number: usize,
    seed: u64,
) -> (Vec<NextEventPair>, [f64; 2]) {
    let view = model.view(evidence, number, None);
    let mut next = NextEvents {
        pairs: Vec::new(),
        random: SplitMix::new(seed ^ NEXT_EVENT_STREAM, number as u64),
        end_us: evidence.blocks.length_us() as f64,
        theta: view.law.theta,
    };
    let spikes = &evidence.pixels[number].spikes;
    visit(&view.law, view.sampled(), spikes, &evidence.blocks, &mut next);
    (next.pairs, view.law.theta)
}
