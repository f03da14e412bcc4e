//! One round of the search: every effect of the library refitted on top of what is known.

use super::bound_escape::{is_full, polished_off_the_ends};
use super::cell_scores::Part;
use super::fitted::Fitted;
use super::gauss_newton::{as_it_is, each_as_it_is, fit, improved};
use super::local_refinement::{LAST_STEPS, fitted, polished};
use super::multistart::{BEST_STARTS, FIRST_STEPS, afresh, restarted, starts_of};
use super::spatial_region::{begun_in_a_part, gain_of, settled};
use crate::diagnose::model::library::{Candidate, LIBRARY};
use crate::diagnose::sensor_wide;
use crate::diagnose::{CannotJudge, Evidence, Hypothesis, Nuisance};
use evrig_core::effect_id::EffectId;

/// Steps of a second fit, on all of them.
const SECOND_STEPS: usize = 6;

/// What a step has to gain, nats an event, for a second fit to go on, and for how many.
const CLIMBING: f64 = 0.01;
const CLIMBING_STEPS: usize = 12;

/// Why nothing is told of single pixels where events come when the readout has time for them.
const HELD_UP: &str = "events wait for a readout that is never free: record fewer at a time, with slower motion or a plainer target";

/// Training gain, nats an event, below which an effect is not fitted further.
const WORTH_A_FIT: f64 = 0.01;

/// Effects that are fitted on few pixels, behind a first step.
const PROMISING: usize = 8;

/// Effects that are then fitted on all.
const BEST: usize = 4;

/// By how much less the noise may be in a part of the picture, natural logarithms, and what that has to gain there
/// for an effect to be looked for in the other part; nats an event of all.
const LESS_NOISE: [f64; 2] = [0.8, 1.6];
const PARTED: f64 = 0.1;

/// What an effect buys on top of a model.
#[derive(Debug, Clone, Copy)]
pub struct Gain {
    /// The effect.
    pub id: EffectId,
    /// Nats an event on training cells.
    pub training: f64,
    /// Nats an event on held-out cells.
    pub held_out: f64,
    /// Standard error of the held-out gain, from its scatter over cells.
    pub error: f64,
}

/// An effect's gain and the model with it.
#[derive(Debug, Clone)]
pub(crate) struct Tried {
    pub(crate) gain: Gain,
    pub(crate) fitted: Fitted,
    /// Whether it was fitted on all pixels, and not on few.
    pub(crate) is_whole: bool,
    /// Whether its fit was gone on with until it stood still.
    pub(crate) is_finished: bool,
}

impl Tried {
    /// The fit gone on with until it stands still.
    pub(crate) fn finished(self, evidence: &Evidence, model: &Fitted) -> Self {
        let has_own_values = model.hypothesis.kinds().is_even();
        let finished = if has_own_values { finished_of_known_kinds } else { finished };
        let fitted = finished(evidence, model, self.fitted);
        Self { fitted, is_whole: true, is_finished: true, ..self }.against(evidence, model)
    }

    /// Whether the effect frees a nuisance of which `model`, without it, has as much as is ordinary: it may ask for
    /// more, and be none of the model's nuisances but a finding.
    pub(crate) fn is_held_back(&self, model: &Hypothesis) -> bool {
        let effect = self.fitted.hypothesis.effects.last();
        effect.into_iter().flat_map(|effect| effect.frees).any(|freed| {
            let (value, [low, high]) = (model.nuisance(freed.nuisance), freed.range);
            is_full(model, freed.nuisance) && low < value && value < high
        })
    }

    /// The same fit measured against a better model without the effect. A first fit on some of the
    /// pixels does not compare and keeps its gain.
    pub(crate) fn against(mut self, evidence: &Evidence, model: &Fitted) -> Self {
        if self.is_whole {
            self.gain.training = self.fitted.cells.gain(&model.cells, Part::Training).0;
            let last = model.hypothesis.effects.len();
            (self.gain.held_out, self.gain.error) = gain_of(evidence, &self.fitted, last, model);
        }
        self
    }
}

/// Why an effect is not in the question. Where the readout `is_saturated` none is that acts on single pixels.
pub(crate) fn cannot_judge(evidence: &Evidence, is_saturated: bool) -> Vec<CannotJudge> {
    let held_up = || is_saturated.then(|| HELD_UP.to_owned());
    let because = |id: EffectId| match LIBRARY.iter().find(|candidate| candidate.id == id) {
        Some(candidate) => (candidate.needs)(evidence).err().or_else(held_up),
        None if LIBRARY.iter().any(|candidate| candidate.same.contains(&id)) => held_up(),
        None => sensor_wide::judge(evidence, id).err(),
    };
    let all = EffectId::ALL.iter().copied();
    all.filter_map(|id| because(id).map(|because| CannotJudge { id, because })).collect()
}

/// Tries every effect that is not in `model` and can be judged. `few` is the same evidence with
/// fewer pixels. Effects come sorted by what they buy on held-out cells.
///
/// All starts of all effects are scored first, on few pixels; the best of each effect are moved one
/// step together with the nuisances; those that then promise most are fitted on few pixels, and the
/// best of these on all.
pub(crate) fn scan(
    evidence: &Evidence,
    few: &Evidence,
    model: &Fitted,
    progress: &mut dyn FnMut(&str),
) -> Vec<Tried> {
    let here = of_known_kinds(few, model);
    let sharp = sharpened(few, &here);
    let mut begun = Vec::new();
    for candidate in in_question(evidence, model) {
        progress(candidate.id.as_str());
        let sharp = sharp.iter().flat_map(|sharp| begun_sharp(evidence, few, sharp, candidate));
        if let Some(first) = first_step(evidence, few, &here, candidate, sharp) {
            begun.push((candidate, first));
        }
    }
    begun.sort_by(|a, b| b.1.training().total_cmp(&a.1.training()));
    for (candidate, fitted) in begun.iter_mut().take(PROMISING) {
        progress(candidate.id.as_str());
        *fitted = fit(few, fitted.hypothesis.clone(), FIRST_STEPS, 1e-4);
    }
    begun.sort_by(|a, b| b.1.training().total_cmp(&a.1.training()));
    let known = here.hypothesis.pinned.is_some().then(|| of_known_kinds(evidence, model));
    let mut all: Vec<Tried> = begun
        .into_iter()
        .enumerate()
        .map(|(rank, (candidate, fitted))| {
            let gained = fitted.training() - here.training();
            let is_worth_it = rank < BEST && gained > WORTH_A_FIT;
            let whole = if is_worth_it {
                progress(candidate.id.as_str());
                on_all(evidence, model, known.as_ref(), fitted.hypothesis.clone())
            } else {
                None
            };
            let is_whole = whole.is_some();
            let mut fitted = whole.unwrap_or(fitted);
            fitted.hypothesis = fitted.hypothesis.unpinned(&model.hypothesis);
            let against = if is_whole { model } else { &here };
            let (training, _) = fitted.cells.gain(&against.cells, Part::Training);
            let last = model.hypothesis.effects.len();
            let (held_out, error) = gain_of(evidence, &fitted, last, against);
            let gain = Gain { id: candidate.id, training, held_out, error };
            Tried { gain, fitted, is_whole, is_finished: false }
        })
        .collect();
    best_first(&mut all);
    all
}

/// An effect that promised much on few pixels, fitted on all. None where it buys nothing there with pixels of unknown
/// kind taken to be as in `known`: scoring them for all kinds is many times the work.
fn on_all(
    evidence: &Evidence,
    model: &Fitted,
    known: Option<&Fitted>,
    start: Hypothesis,
) -> Option<Fitted> {
    let Some(known) = known else {
        let begun = fitted(evidence, start, SECOND_STEPS, 1e-4);
        return Some(improved(evidence, begun, CLIMBING_STEPS, CLIMBING));
    };
    let there = fit(evidence, start.pinned_as(&known.hypothesis), SECOND_STEPS, 1e-4);
    (there.training() - known.training() > WORTH_A_FIT).then_some(())?;
    let there = as_it_is(evidence, there.hypothesis.unpinned(&model.hypothesis));
    Some(improved(evidence, there, SECOND_STEPS, CLIMBING))
}

/// A fit with one more effect than `model` gone on with until it stands still.
fn finished(evidence: &Evidence, model: &Fitted, begun: Fitted) -> Fitted {
    let fresh = afresh(evidence, &begun.hypothesis);
    let start = restarted(evidence, begun).hypothesis;
    let begun = fitted(evidence, start, LAST_STEPS, 1e-5);
    let there = polished_off_the_ends(evidence, fresh.into_iter().fold(begun, Fitted::or_better));
    settled(evidence, model, there)
}

/// The same where pixels have each a value of their own: with each taken to have its likeliest, which is scored once
/// where all are many times the work, and then once more with values that are not known again.
fn finished_of_known_kinds(evidence: &Evidence, model: &Fitted, begun: Fitted) -> Fitted {
    let start = begun.hypothesis.clone().pinned(evidence);
    let without = model.hypothesis.clone().pinned_as(&start);
    let without = fit(evidence, without, LAST_STEPS, 1e-4);
    let there = finished(evidence, &without, as_it_is(evidence, start));
    let there = as_it_is(evidence, there.hypothesis.unpinned(&model.hypothesis));
    polished(evidence, improved(evidence, begun.or_better(there), LAST_STEPS, 1e-4))
}

/// Sorts by what is bought on held-out cells, fits on all pixels first: what was fitted on few is none to take.
pub(crate) fn best_first(tried: &mut [Tried]) {
    tried.sort_by(|a, b| {
        let of_all = b.is_whole.cmp(&a.is_whole);
        of_all.then(b.gain.held_out.total_cmp(&a.gain.held_out))
    });
}

/// The model on few pixels, those of unknown kind taken to be of their likeliest. For kinds that are known the
/// best values are others: what they gain is no effect's, so that they are looked for to the end.
fn of_known_kinds(few: &Evidence, model: &Fitted) -> Fitted {
    let here = as_it_is(few, model.hypothesis.clone().pinned(few));
    if here.hypothesis.pinned.is_some() { improved(few, here, LAST_STEPS, 1e-4) } else { here }
}

/// The model with less noise, where that foretells a part of the pixels much better: an effect in the other
/// part has passed for noise everywhere.
fn sharpened(few: &Evidence, model: &Fitted) -> Option<Fitted> {
    let noise = model.hypothesis.nuisance(Nuisance::LogNoise);
    let less =
        LESS_NOISE.map(|less| model.hypothesis.with_nuisance(Nuisance::LogNoise, noise - less));
    let scored = each_as_it_is(few, less.to_vec()).into_iter().map(|sharp| {
        (sharp.cells.gain_where_any(&model.cells, Part::Training, few.blocks.n()), sharp)
    });
    let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(gain, _)| *gain > PARTED).map(|(_, sharp)| sharp)
}

/// An effect's starts in the part of the picture that a model with less noise foretells worse for want of it.
fn begun_sharp(
    evidence: &Evidence,
    few: &Evidence,
    sharp: &Fitted,
    candidate: &'static Candidate,
) -> Vec<Fitted> {
    let starts = (candidate.starts)(evidence);
    let starts = starts.iter().map(|start| sharp.hypothesis.with(candidate, start)).collect();
    let begun = each_as_it_is(few, starts);
    begun.iter().filter_map(|start| begun_in_a_part(few, sharp, start)).collect()
}

/// Effects that the model has not and that can be judged.
fn in_question(evidence: &Evidence, model: &Fitted) -> Vec<&'static Candidate> {
    let effects = &model.hypothesis.effects;
    let has_mixture = effects.iter().any(|effect| effect.mixture.is_some());
    LIBRARY
        .into_iter()
        .filter(|candidate| effects.iter().all(|effect| effect.id != candidate.id))
        .filter(|candidate| !(has_mixture && candidate.mixture.is_some()))
        .filter(|candidate| (candidate.needs)(evidence).is_ok())
        .collect()
}

/// The best of an effect's starts behind one step; `model` is scored on few pixels. `None` for an effect
/// without any.
pub(crate) fn first_step(
    evidence: &Evidence,
    few: &Evidence,
    model: &Fitted,
    candidate: &'static Candidate,
    sharp: impl Iterator<Item = Fitted>,
) -> Option<Fitted> {
    let mut begun = each_as_it_is(few, starts_of(evidence, &model.hypothesis, candidate));
    // Tile by tile a gain is the effect's where nothing else has changed.
    let same_nuisances = |start: &&Fitted| {
        let is_freed = |i: usize| candidate.frees.iter().any(|freed| freed.nuisance as usize == i);
        let pairs = start.hypothesis.values.iter().zip(&model.hypothesis.values);
        pairs.enumerate().all(|(i, (there, here))| there == here || is_freed(i))
    };
    let in_parts: Vec<Fitted> = begun
        .iter()
        .filter(same_nuisances)
        .filter_map(|start| begun_in_a_part(few, model, start))
        .collect();
    begun.extend(in_parts.into_iter().chain(sharp));
    begun.sort_by(|a, b| b.training().total_cmp(&a.training()));
    // A parameter that keeps the value it starts with parts the starts: the best of each part. So does
    // whether nuisances begin elsewhere: what that buys shows only behind the step.
    let own = model.hypothesis.values.len();
    let part = |fitted: &Fitted| -> (bool, Vec<u64>) {
        let values = fitted.hypothesis.values.iter().zip(&fitted.hypothesis.steps).skip(own);
        let kept = values.filter(|(_, step)| **step == 0.0).map(|(value, _)| value.to_bits());
        (same_nuisances(&fitted), kept.collect())
    };
    let mut seen: Vec<((bool, Vec<u64>), usize)> = Vec::new();
    begun.retain(|fitted| {
        let part = part(fitted);
        match seen.iter_mut().find(|(known, _)| *known == part) {
            Some((_, n)) => {
                *n += 1;
                *n <= BEST_STARTS
            }
            None => {
                seen.push((part, 1));
                true
            }
        }
    });
    begun
        .into_iter()
        .map(|fitted| improved(few, fitted, 2, 1e-4))
        .max_by(|a, b| a.training().total_cmp(&b.training()))
}
