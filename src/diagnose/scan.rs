//! One round of the search: every effect of the library refitted on top of what is known.

use super::candidate::{Candidate, LIBRARY};
use super::fit::{Fitted, as_it_is, fit};
use super::score::Part;
use super::{CannotJudge, Evidence};
use crate::effect_id::EffectId;

/// Steps of a first fit, on some of the pixels.
const FIRST_STEPS: usize = 4;

/// Steps of a second fit, on all of them.
const SECOND_STEPS: usize = 6;

/// Training gain, nats an event, below which an effect is not fitted further.
const WORTH_A_FIT: f64 = 0.002;

/// Starts that are fitted further.
const BEST_STARTS: usize = 2;

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
pub(super) struct Tried {
    pub(super) gain: Gain,
    pub(super) fitted: Fitted,
}

impl Tried {
    /// The same fit measured against a better model without the effect. A first fit on some of the
    /// pixels does not compare and keeps its gain.
    pub(super) fn against(mut self, model: &Fitted) -> Self {
        let n_events = |fitted: &Fitted| fitted.cells.n_events.iter().sum::<f64>();
        if n_events(&self.fitted) == n_events(model) {
            self.gain.training = self.fitted.cells.gain(&model.cells, Part::Training).0;
            let (held_out, error) = self.fitted.cells.gain(&model.cells, Part::HeldOut);
            (self.gain.held_out, self.gain.error) = (held_out, error);
        }
        self
    }
}

/// Why an effect is not in the question.
pub(super) fn cannot_judge(evidence: &Evidence) -> Vec<CannotJudge> {
    let mut list = Vec::new();
    for &id in EffectId::ALL {
        let because = match LIBRARY.iter().find(|candidate| candidate.id == id) {
            Some(candidate) => (candidate.needs)(evidence).err(),
            None if LIBRARY.iter().any(|candidate| candidate.same.contains(&id)) => None,
            None => Some(absent(id).to_owned()),
        };
        if let Some(because) = because {
            list.push(CannotJudge { id, because });
        }
    }
    list
}

/// Why an effect has no place in the library.
fn absent(id: EffectId) -> &'static str {
    match id {
        EffectId::ToneCurve => {
            "a power law of the frames is one number with the threshold; it takes a step wedge"
        }
        EffectId::Vignetting => "it cancels in the logarithm, but for motion across the shading",
        EffectId::RowReadout | EffectId::ReadoutSaturation => {
            "its trace is in the order of the stamps of all pixels, which is not looked at yet"
        }
        EffectId::ApsCoupling => "its trace at the camera's frames is not looked at yet",
        _ => "its trace is not looked at yet",
    }
}

/// Tries every effect that is not in `model` and can be judged. `few` is the same evidence with
/// fewer pixels, for first fits. Effects come sorted by what they buy on held-out cells.
pub(super) fn scan(
    evidence: &Evidence,
    few: &Evidence,
    model: &Fitted,
    progress: &mut dyn FnMut(&str),
) -> Vec<Tried> {
    let here = as_it_is(few, model.hypothesis.clone());
    let mut all = Vec::new();
    for candidate in LIBRARY {
        let taken = model.hypothesis.effects.iter().any(|effect| effect.id == candidate.id);
        let second_mixture = candidate.mixture.is_some()
            && model.hypothesis.effects.iter().any(|effect| effect.mixture.is_some());
        if taken || second_mixture || (candidate.needs)(evidence).is_err() {
            continue;
        }
        progress(candidate.id.as_str());
        if let Some(tried) = try_one(evidence, few, &here, model, candidate) {
            all.push(tried);
        }
    }
    all.sort_by(|a, b| b.gain.held_out.total_cmp(&a.gain.held_out));
    all
}

fn try_one(
    evidence: &Evidence,
    few: &Evidence,
    here: &Fitted,
    model: &Fitted,
    candidate: &'static Candidate,
) -> Option<Tried> {
    let starts = (candidate.starts)(evidence);
    let mut begun: Vec<Fitted> =
        starts.iter().map(|start| as_it_is(few, model.hypothesis.with(candidate, start))).collect();
    begun.sort_by(|a, b| b.cells.nats(Part::Training).total_cmp(&a.cells.nats(Part::Training)));
    begun.truncate(BEST_STARTS);
    let first = begun
        .into_iter()
        .map(|fitted| fit(few, fitted.hypothesis, FIRST_STEPS, 1e-4))
        .max_by(|a, b| a.cells.nats(Part::Training).total_cmp(&b.cells.nats(Part::Training)))?;
    let promising =
        first.cells.nats(Part::Training) - here.cells.nats(Part::Training) > WORTH_A_FIT;
    let (fitted, against) = if promising {
        (fit(evidence, first.hypothesis, SECOND_STEPS, 1e-4), model)
    } else {
        (first, here)
    };
    let (training, _) = fitted.cells.gain(&against.cells, Part::Training);
    let (held_out, error) = fitted.cells.gain(&against.cells, Part::HeldOut);
    Some(Tried { gain: Gain { id: candidate.id, training, held_out, error }, fitted })
}
