//! The search as a whole: baseline, effects one by one, null, structure left, verdict.

use crate::diagnose::checks::accepted_effect::Taken;
use crate::diagnose::checks::effect_review::{Judge, Judged};
use crate::diagnose::checks::null_distribution;
use crate::diagnose::checks::pruning::{leave_out_below, leave_out_vague, prune};
use crate::diagnose::checks::split_half::halves;
use crate::diagnose::checks::two_sample_test::structure;
use crate::diagnose::fit::cell_scores::{LEAST_ERRORS, LEAST_GAIN, Part, is_enough, is_suspicious};
use crate::diagnose::fit::effect_scan::{Gain, Tried, best_first, scan};
use crate::diagnose::fit::fitted::Fitted;
use crate::diagnose::fit::gauss_newton::{as_it_is, each_as_it_is, fit, improved};
use crate::diagnose::fit::local_refinement::fitted_and_polished;
use crate::diagnose::fit::spatial_region::gain_of;
use crate::diagnose::report::conclusion::{Reached, conclude};
use crate::diagnose::report::departure::{Departure, as_effects};
use crate::diagnose::report::heat_map::{HeatMap, heat_maps};
use crate::diagnose::sensor_wide::{Census, census};
use crate::diagnose::{
    Diagnosis, Evidence, Hypothesis, Nuisance, NullReport, Options, Rival, Suspect,
};
use evrig_core::geometry::Rectangle;

/// A rival that buys this share of what the best does is fitted to the end before one is taken.
const NEAR: f64 = 0.4;

/// Less than this, nats an event, is not much for the best to buy.
const MUCH: f64 = 0.1;

/// Rivals, the best included, that are.
const MOST_RIVALS: usize = 3;

/// Steps from what a coarse score finds to what the fine one does, which is near.
const FINE_STEPS: usize = 12;

/// Events on which first fits are made.
const FEW_EVENTS: usize = 6_000;

/// Offsets of the clocks to either side that are begun with.
const OFFSETS: i32 = 5;

/// A diagnosis with the models behind it.
#[derive(Debug, Clone)]
pub struct Diagnosed {
    /// What is said.
    pub diagnosis: Diagnosis,
    /// Nuisances alone.
    pub baseline: Hypothesis,
    /// With the named effects; the baseline where none is named.
    pub model: Hypothesis,
    /// Where either is wrong, to look at.
    pub heat: Vec<HeatMap>,
}

/// Diagnoses: which effects of the library does the recording show beyond the baseline?
///
/// `departures` are what its frames show otherwise than stated; the evidence's light has them.
/// `progress` is told what is being looked at.
#[must_use]
pub fn diagnose(
    evidence: &Evidence,
    departures: &[Departure],
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> Diagnosed {
    let Census { departures: counted, rest, is_saturated, alone } = census(evidence);
    let evidence = rest.as_ref().unwrap_or(evidence);
    let max_effects = if is_saturated { 0 } else { options.max_effects };
    progress("baseline");
    let few = evidence.thinned((evidence.n_events() / FEW_EVENTS).max(2));
    let baseline = begin(evidence, &few);
    let (baseline, model, taken, unsure) =
        take_all(evidence, &few, baseline, max_effects, progress);
    // What is made of either from here on is fine as well, but for what leaves out the idle.
    let baseline = baseline.made_fine(true);
    progress("structure left");
    let before = structure(evidence, &baseline, options.seed);
    let judge = Judge {
        evidence,
        baseline: &baseline,
        before: before.as_ref(),
        null: &[],
        is_more_suspected: unsure.is_some(),
        is_filtered: alone.is_some(),
        seed: options.seed,
    };
    let Stands { judged, reach, null } =
        what_stands(&judge, &few, (model, taken), options, progress);
    let Judged { model, taken, standing, after, mut suspects } = judged;
    suspects.extend(unsure);
    let (model, taken) = match model.errors {
        Some(_) => (model, taken),
        None => leave_out_vague(evidence, &baseline, model, taken),
    };
    progress("halves");
    let halves = if taken.is_empty() { Vec::new() } else { halves(evidence, &baseline, &model) };
    let departed = as_effects(evidence, departures.iter().chain(&counted), &baseline);
    let reached = Reached {
        taken,
        standing,
        before,
        after,
        reach,
        suspects,
        halves,
        null,
        is_saturated,
        alone,
        departed,
    };
    Diagnosed {
        diagnosis: conclude(evidence, &baseline, &model, reached),
        heat: heat_maps(evidence, [&baseline, &model]),
        baseline: baseline.hypothesis,
        model: model.hypothesis,
    }
}

/// What stands of what was found.
struct Stands {
    judged: Judged,
    reach: f64,
    null: NullReport,
}

/// Leaves out of a model what is idle, what chance buys as well, what fits at any strength, and judges the rest; all
/// of that takes as long as the search, and is not asked of a model that is lost.
fn what_stands(
    judge: &Judge<'_>,
    few: &Evidence,
    (model, taken): (Fitted, Vec<Taken>),
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> Stands {
    let Judge { evidence, baseline, .. } = *judge;
    let reach = |model: &Fitted| crate::diagnose::report::conclusion::reach(evidence, model);
    if let Some(judged) = judge.lost(&model, &taken) {
        let null = NullReport { bar_nats_per_event: LEAST_GAIN, ..NullReport::default() };
        return Stands { reach: reach(&model), judged, null };
    }
    progress("idle effects");
    let coarse = baseline.clone().made_fine(false);
    let (model, taken) = prune(evidence, few, &coarse, model, taken);
    let found = (model.made_fine(true), taken);
    let (model, taken, null) = beyond_chance(evidence, few, baseline, found, options, progress);
    progress("fine score");
    let model = refined(evidence, model);
    let judge = Judge { null: &null.structures_nats_per_event, ..*judge };
    progress("errors");
    // What no name may stand on needs none.
    let (model, taken) = if judge.fails(&model) {
        (model, taken)
    } else {
        leave_out_vague(evidence, baseline, model, taken)
    };
    let reach = reach(&model);
    Stands { judged: judge.judged(model, taken), reach, null }
}

/// The model without what buys no more than chance does, which is asked before what stands is looked at finely.
fn beyond_chance(
    evidence: &Evidence,
    few: &Evidence,
    baseline: &Fitted,
    (model, taken): (Fitted, Vec<Taken>),
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> (Fitted, Vec<Taken>, NullReport) {
    progress("null");
    let null_distribution::Drawn { gains, structures } =
        null_distribution::drawn(evidence, few, &model, options.n_null, options.seed, progress);
    let worst = gains.iter().copied().fold(0.0, f64::max);
    let bar = LEAST_GAIN
        .max(worst)
        .max(0.01 * crate::diagnose::report::conclusion::excess(evidence, baseline, &model));
    let (model, taken) = leave_out_below(evidence, baseline, model, taken, bar);
    let null = NullReport {
        n: options.n_null,
        greatest_gains: gains,
        bar_nats_per_event: bar,
        structures_nats_per_event: structures,
    };
    (model, taken, null)
}

/// Nuisances alone, fitted. Light between frames is rough in time, so that slopes lead to the next best
/// offset of the clocks: some all over its range are begun with.
fn begin(evidence: &Evidence, few: &Evidence) -> Fitted {
    let mut begun = fit(few, Hypothesis::baseline(evidence), 12, 1e-4);
    if evidence.facts.is_led {
        let us = evidence.facts.offset_within_us / f64::from(OFFSETS);
        let at = |i| begun.hypothesis.with_nuisance(Nuisance::OffsetUs, us * f64::from(i));
        let elsewhere = each_as_it_is(few, (-OFFSETS..=OFFSETS).map(at).collect());
        let best = elsewhere.into_iter().max_by(|a, b| a.training().total_cmp(&b.training()));
        let there = best.map(|best| improved(few, best, 12, 1e-4));
        begun = there.into_iter().fold(begun, Fitted::or_better);
    }
    fitted_and_polished(evidence, begun.hypothesis, 12)
}

/// Takes effects one by one while they buy enough. A fit with an effect may come by better
/// nuisances than the fit without had found; the model then takes them over before it is compared,
/// so that they are not booked to the effect.
fn take_all(
    evidence: &Evidence,
    few: &Evidence,
    mut baseline: Fitted,
    max_effects: usize,
    progress: &mut dyn FnMut(&str),
) -> (Fitted, Fitted, Vec<Taken>, Option<Suspect>) {
    let mut model = baseline.clone();
    let (mut taken, mut unsure) = (Vec::new(), None);
    while taken.len() < max_effects {
        let mut tried: Vec<Tried> = scan(evidence, few, &model, progress)
            .into_iter()
            .filter(|tried| has_signature(evidence, tried, within_its_tiles))
            .collect();
        for _ in 0..3 {
            let Some(best) = tried.first() else { break };
            let same = model.hypothesis.at_values_of(&best.fitted.hypothesis);
            let without = fit(evidence, same, 6, 1e-5);
            if without.training() <= model.training() + 1e-4 {
                break;
            }
            model = without;
            if taken.is_empty() {
                baseline = model.clone();
            }
            tried = tried.into_iter().map(|tried| tried.against(evidence, &model)).collect();
            best_first(&mut tried);
        }
        polish_rivals(evidence, &model, &mut tried, progress);
        if tried.first().is_some_and(|best| !holds_finely(evidence, &model, best)) {
            tried.remove(0);
            polish_rivals(evidence, &model, &mut tried, progress);
        }
        tried.retain(|tried| has_signature(evidence, tried, |_, region| region));
        let Some(best) = tried.first() else { break };
        let gain = best.gain;
        if !best.is_whole {
            break;
        }
        if !is_enough(gain.held_out, gain.error) {
            unsure = suspected(gain);
            break;
        }
        progress(&format!("{} is taken", gain.id));
        taken.push(Taken {
            gain: gain.held_out,
            error: gain.error,
            rivals: rivals(&tried),
            equals: equals(&tried),
        });
        model = best.fitted.clone();
    }
    (baseline, model, taken, unsure)
}

/// Whether the fine score of pixels with thresholds of their own leaves an effect the name or the suspicion that the
/// coarse one gives it. Between thresholds that the coarse one looks at it goes along slopes, and a camera that is all
/// but ideal scores less there than they promise.
pub(crate) fn holds_finely(evidence: &Evidence, model: &Fitted, tried: &Tried) -> bool {
    let coarse = &tried.fitted.hypothesis;
    let has_own = coarse.kinds().is_even() && !model.hypothesis.kinds().is_even();
    let (gain, error) = (tried.gain.held_out, tried.gain.error);
    let asked = if is_enough(gain, error) { is_enough } else { is_suspicious };
    if !has_own || !asked(gain, error) {
        return true;
    }
    let holds = |fine: &Fitted| {
        let (gain, error) = gain_of(evidence, fine, model.hypothesis.effects.len(), model);
        asked(gain, error)
    };
    let fine = as_it_is(evidence, Hypothesis { is_fine: true, ..coarse.clone() });
    holds(&fine) || holds(&improved(evidence, fine, FINE_STEPS, 1e-4))
}

/// An effect that buys much and not surely: the model without it is not said to hold.
fn suspected(gain: Gain) -> Option<Suspect> {
    let errors = gain.held_out / gain.error;
    is_suspicious(gain.held_out, gain.error).then(|| Suspect {
        id: gain.id,
        heldout_gain_nats_per_event: gain.held_out,
        because: format!(
            "what it gains is {errors:.2} of its standard errors, and a name takes {LEAST_ERRORS:.0}: more \
             pixels (--pixels) or a longer recording may tell"
        ),
    })
}

/// Finishes the fits of those that come near to the best, the best among them: a pole and a late clock,
/// half fitted, may stand in the wrong order. So may, however little it buys so far, one that physics knows for the
/// best one's rival, and where nothing buys much one of whose nuisance there is as much as is ordinary: a leak
/// that an all but ideal camera tells finely is behind a ridge until then.
fn polish_rivals(
    evidence: &Evidence,
    model: &Fitted,
    tried: &mut Vec<Tried>,
    progress: &mut dyn FnMut(&str),
) {
    let Some(first) = tried.first() else { return };
    let best = first.gain.held_out;
    let known = first.fitted.hypothesis.effects.last().map_or(&[][..], |effect| effect.rivals);
    let near = |tried: &Tried| {
        let is_rival = tried.gain.held_out > NEAR * best || known.contains(&tried.gain.id);
        (tried.is_whole && best >= LEAST_GAIN && is_rival)
            || (best < MUCH && tried.is_held_back(&model.hypothesis))
    };
    let (rivals, rest): (Vec<Tried>, Vec<Tried>) = tried.drain(..).partition(near);
    let n_finished = rivals.len().min(MOST_RIVALS);
    tried.extend(rivals.into_iter().enumerate().map(|(i, rival)| {
        if i >= n_finished || rival.is_finished {
            return rival;
        }
        progress(&format!("{} to the end", rival.gain.id));
        rival.finished(evidence, model)
    }));
    tried.extend(rest);
    best_first(tried);
}

/// Whether what belongs to the effect that was tried last is in the events of its region, or of what
/// `inner` makes of that.
fn has_signature(
    evidence: &Evidence,
    tried: &Tried,
    inner: impl Fn(&Evidence, Rectangle) -> Rectangle,
) -> bool {
    let hypothesis = &tried.fitted.hypothesis;
    let last = hypothesis.effects.len() - 1;
    let part = hypothesis.regions[last].map(|region| evidence.within(inner(evidence, region)));
    let there = part.as_ref().unwrap_or(evidence);
    (hypothesis.effects[last].agrees)(there, &hypothesis.parameters_of(last))
}

/// A region that is made of whole tiles, without those at its edges: part of them may lie outside.
fn within_its_tiles(evidence: &Evidence, region: Rectangle) -> Rectangle {
    let tile = evidence.tile_px;
    let inner = |[low, high]: [u16; 2]| {
        if high - low > 2 * tile { [low + tile, high - tile] } else { [low, high] }
    };
    Rectangle { x_px: inner(region.x_px), y_px: inner(region.y_px) }
}

fn rivals(tried: &[Tried]) -> Vec<Rival> {
    let rest = tried.iter().skip(1).take(5);
    rest.map(|t| Rival { id: t.gain.id, heldout_gain_nats_per_event: t.gain.held_out }).collect()
}

/// Those whose score is below the best's by less than a name takes: that is too little for a choice, too.
fn equals(tried: &[Tried]) -> Vec<evrig_core::effect_id::EffectId> {
    let Some(best) = tried.first() else { return Vec::new() };
    let close = |t: &&Tried| {
        let (gain, error) = best.fitted.cells.gain(&t.fitted.cells, Part::HeldOut);
        !is_enough(gain, error)
    };
    // A first fit on some of the pixels does not compare.
    tried.iter().skip(1).filter(|t| t.is_whole).filter(close).map(|t| t.gain.id).collect()
}

/// A model found by the coarse score of pixels whose thresholds are their own, by the fine one.
fn refined(evidence: &Evidence, model: Fitted) -> Fitted {
    if !model.hypothesis.kinds().is_even() {
        return model;
    }
    fitted_and_polished(evidence, model.hypothesis, FINE_STEPS)
}
