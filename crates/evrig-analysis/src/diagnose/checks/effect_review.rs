//! Which of the effects that were taken may be named.

use super::acceptance::{Standing, at_an_end, inconstant, is_lost, leaves_much, standing};
use super::accepted_effect::Taken;
use super::null_distribution;
use super::pruning::refit_with;
use super::strength_constancy::strengths;
use super::two_sample_test::{Structure, structure};
use super::upper_bound::flexible;
use crate::diagnose::fit::fitted::Fitted;
use crate::diagnose::{Evidence, Suspect};
use evrig_core::effect_id::EffectId;

/// A model of which every effect may be named, and what may not.
pub(crate) struct Judged {
    pub(crate) model: Fitted,
    pub(crate) taken: Vec<Taken>,
    pub(crate) standing: Standing,
    /// What the model leaves; where nothing may be named, what that with all that was taken left.
    pub(crate) after: Option<Structure>,
    pub(crate) suspects: Vec<Suspect>,
}

/// What names are judged by.
pub(crate) struct Judge<'a> {
    pub(crate) evidence: &'a Evidence,
    pub(crate) baseline: &'a Fitted,
    /// What the baseline leaves.
    pub(crate) before: Option<&'a Structure>,
    /// The structures in recordings drawn from the model.
    pub(crate) null: &'a [f64],
    /// Whether something of the library gains on what is left, and not enough for a name.
    pub(crate) is_more_suspected: bool,
    /// Whether events are missing that no neighbour's came before.
    pub(crate) is_filtered: bool,
    pub(crate) seed: u64,
}

/// How a model looks.
struct Look {
    after: Option<Structure>,
    standing: Standing,
    /// Why each effect may not be named.
    doubts: Vec<Option<String>>,
    /// Why none of them may.
    of_all: Option<String>,
}

impl Look {
    fn holds(&self) -> bool {
        self.of_all.is_none() && self.doubts.iter().all(Option::is_none)
    }
}

impl Judge<'_> {
    /// Takes back what does not hold: effects that have not one strength, and all of them where the
    /// model leaves what it should have removed. What stands in for one effect has moved the others,
    /// so those that are left are fitted and judged anew.
    pub(crate) fn judged(&self, model: Fitted, taken: Vec<Taken>) -> Judged {
        let look = self.look(&model, self.stands(&model));
        if look.holds() {
            let Look { after, standing, .. } = look;
            return Judged { model, taken, standing, after, suspects: Vec::new() };
        }
        let suspects = suspects(&model, &taken, &look);
        let kept: Vec<usize> = (0..taken.len()).filter(|&i| look.doubts[i].is_none()).collect();
        if !kept.is_empty() && kept.len() < taken.len() {
            let rest = refit_with(self.evidence, self.baseline, &model, &kept);
            let again = self.look(&rest, self.stands(&rest));
            if again.holds() {
                let taken = of(taken, &look.doubts, Option::is_none);
                let suspects = of(suspects, &look.doubts, Option::is_some);
                let Look { after, standing, .. } = again;
                return Judged { model: rest, taken, standing, after, suspects };
            }
        }
        self.nothing(look, suspects)
    }

    /// Takes back all of a model that is lost: it leaves nearly all that was to be explained, and that is much.
    pub(crate) fn lost(&self, model: &Fitted, taken: &[Taken]) -> Option<Judged> {
        if taken.is_empty() {
            return None;
        }
        let stands = self.stands(model);
        is_lost(self.before, stands.0.as_ref()).then(|| {
            let look = self.look(model, stands);
            let suspects = suspects(model, taken, &look);
            self.nothing(look, suspects)
        })
    }

    fn nothing(&self, look: Look, suspects: Vec<Suspect>) -> Judged {
        let Look { after, standing, .. } = look;
        Judged { model: self.baseline.clone(), taken: Vec::new(), standing, after, suspects }
    }

    /// Whether a model leaves most of what was to be explained.
    pub(crate) fn fails(&self, model: &Fitted) -> bool {
        self.stands(model).1 == Standing::Fails
    }

    /// What a model leaves, and how it stands by that.
    fn stands(&self, model: &Fitted) -> (Option<Structure>, Standing) {
        let after = structure(self.evidence, model, self.seed);
        let standing = standing(self.before, after.as_ref(), self.null, is_seen(model));
        (after, standing)
    }

    /// What a model leaves to no effect of the library, in words, if it is so much that no name may stand on it. Errors of
    /// a light that is guessed between frames are left by any model.
    fn left_to_nothing(&self, model: &Fitted) -> Option<String> {
        if self.is_more_suspected || !self.evidence.facts.is_light_dense() || !is_seen(model) {
            return None;
        }
        let left = flexible(self.evidence, model);
        let removed = model.held_out() - self.baseline.held_out();
        leaves_much(removed, left).then(|| {
            format!(
                "it removes {removed:.2} nats an event, and leaves {:.2} that nothing in the library explains",
                left.gain
            )
        })
    }

    /// Why an effect of the model only stands in for a filter, if it does: such a filter does not take any share at random.
    fn filtered(&self, model: &Fitted, index: usize) -> Option<String> {
        let is_loss = model.hypothesis.effects[index].id == EffectId::EventDrop;
        (self.is_filtered && is_loss)
            .then(|| "what is missing is what no neighbour's event came before".to_owned())
    }

    fn look(&self, model: &Fitted, (after, standing): (Option<Structure>, Standing)) -> Look {
        let n = model.hypothesis.effects.len();
        let of_all = match standing {
            Standing::Fails => {
                Some("events drawn with it are still told from the camera's".to_owned())
            }
            Standing::Holds | Standing::InPart => self.left_to_nothing(model),
        };
        let drawn = null_distribution::draw(self.evidence, &model.hypothesis, self.seed);
        let own = |index: usize| doubt(self.evidence, &drawn, model, index);
        let doubts = (0..n).map(|index| self.filtered(model, index).or_else(|| own(index)));
        let doubts = doubts.collect();
        Look { after, standing, doubts, of_all }
    }
}

/// Whether a model has an effect that shows behind events: what takes all events of a pixel leaves none behind which one
/// could look.
fn is_seen(model: &Fitted) -> bool {
    model.hypothesis.effects.iter().any(|effect| !effect.is_silent)
}

/// What belongs to the effects whose doubts are as asked.
fn of<T>(all: Vec<T>, doubts: &[Option<String>], is_asked: fn(&Option<String>) -> bool) -> Vec<T> {
    let own = all.into_iter().zip(doubts).filter(|(_, doubt)| is_asked(doubt));
    own.map(|(each, _)| each).collect()
}

/// What an effect of the model asks for that it cannot have, or where it has another strength than
/// elsewhere, in words.
fn doubt(evidence: &Evidence, drawn: &Evidence, model: &Fitted, index: usize) -> Option<String> {
    if let Some(parameter) = at_an_end(&model.hypothesis, index) {
        let [low, high] = parameter.range;
        return Some(format!("{} is at an end of its range, {low} to {high}", parameter.key));
    }
    let strengths = strengths(evidence, drawn, model, index);
    let worst = inconstant(&strengths)?;
    let [low, high] = worst.range;
    let how = match worst.change {
        less if less < -0.8 => "it is as good as absent",
        less if less < 0.0 => "it is much weaker",
        _ => "it is much stronger",
    };
    Some(format!("with {} from {low:.4} to {high:.4} {how}", worst.covariate))
}

/// All effects of a model that does not hold, each with the reason.
fn suspects(model: &Fitted, taken: &[Taken], look: &Look) -> Vec<Suspect> {
    let effects = model.hypothesis.effects.iter().zip(taken).zip(&look.doubts);
    let together = || "it was found together with one that does not hold".to_owned();
    effects
        .map(|((effect, taken), doubt)| Suspect {
            id: effect.id,
            heldout_gain_nats_per_event: taken.gain,
            because: doubt.as_ref().or(look.of_all.as_ref()).cloned().unwrap_or_else(together),
        })
        .collect()
}
