//! A plan of trials, drawn from a seed.

use super::strength::{Strength, strengths};
use super::{Concealed, Family, Rectangle, Trial, Truth};
use crate::stats::SplitMix;

/// The strongest an effect is drawn, in units of its least strength.
const STRONGEST: f64 = 4.0;

/// How many trials of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mix {
    /// Whose sessions.
    pub family: Family,
    /// With one effect, each effect of the table in turn.
    pub single: usize,
    /// With two effects.
    pub double: usize,
    /// With none.
    pub clean: usize,
    /// With one that the library does not know.
    pub alien: usize,
}

/// Pictures and trajectories of the simulated rig that trials take in turn.
const PICTURES: &[&str] = &["leaves-1", "leaves-2", "leaves-3", "leaves-4"];
const TRAJECTORIES: &[&str] = &["circle", "figure-eight"];

/// Draws the trials of a mix: the same seed gives the same trials.
#[must_use]
pub fn draw(mix: Mix, seed: u64) -> Vec<Trial> {
    let (known, alien) = strengths(mix.family);
    let mut kinds: Vec<Vec<&Strength>> = Vec::new();
    let mut order = SplitMix::new(seed, u64::MAX);
    // One after another from a shuffled table, so that few trials still cover many effects.
    let deck = shuffled(known.len(), &mut order);
    let pick = |i: usize| (!deck.is_empty()).then(|| &known[deck[i % deck.len()]]);
    kinds.extend((0..mix.single).filter_map(|i| pick(i).map(|s| vec![s])));
    kinds.extend((0..mix.double).filter_map(|i| pair(known, &mut order, i)));
    kinds.extend((0..mix.clean).map(|_| Vec::new()));
    let first = order.below(alien.len().max(1));
    kinds.extend(
        (0..mix.alien).filter_map(|i| alien.get((first + i) % alien.len().max(1))).map(|s| vec![s]),
    );
    let kinds = shuffled(kinds.len(), &mut order).into_iter().map(|i| kinds[i].clone());
    kinds.enumerate().map(|(number, kind)| trial(mix.family, number, &kind, seed)).collect()
}

fn pair<'a>(known: &'a [Strength], random: &mut SplitMix, _: usize) -> Option<Vec<&'a Strength>> {
    if known.len() < 2 {
        return None;
    }
    let first = random.below(known.len());
    let second = (first + 1 + random.below(known.len() - 1)) % known.len();
    Some(vec![&known[first], &known[second]])
}

fn shuffled(n: usize, random: &mut SplitMix) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, random.below(i + 1));
    }
    order
}

fn trial(family: Family, number: usize, kind: &[&Strength], seed: u64) -> Trial {
    let mut random = SplitMix::new(seed, number as u64);
    let effects = kind
        .iter()
        .map(|entry| {
            // Even in the logarithm: as many trials between 1 and 2 as between 2 and 4.
            let strength = STRONGEST.powf(random.uniform());
            Concealed { id: entry.id.into(), parameters: entry.parameters(strength), strength }
        })
        .collect();
    let (mut picture, mut trajectory) = (String::new(), String::new());
    if family == Family::World {
        picture = PICTURES[random.below(PICTURES.len())].into();
        trajectory = TRAJECTORIES[random.below(TRAJECTORIES.len())].into();
    }
    let nonce = format!("{:016x}{:016x}", random.bits(), random.bits());
    let region: Option<Rectangle> = None;
    let truth = Truth { schema: "evrig.truth/1".into(), effects, region, nonce };
    let name = format!("{}-{number:03}", family.as_str());
    Trial { name, family, picture, trajectory, seed: random.bits(), truth }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    const MIX: Mix = Mix { family: Family::World, single: 30, double: 4, clean: 6, alien: 3 };

    #[test]
    fn a_seed_draws_the_same_trials_and_another_seed_others() {
        assert_eq!(draw(MIX, 3), draw(MIX, 3));
        assert_ne!(draw(MIX, 3), draw(MIX, 4));
    }

    #[test]
    fn the_kinds_are_as_many_as_asked_for_and_in_no_order() {
        let trials = draw(MIX, 8);
        let count =
            |test: &dyn Fn(&Truth) -> bool| trials.iter().filter(|t| test(&t.truth)).count();
        assert_eq!(trials.len(), 43);
        assert_eq!(count(&Truth::is_clean), 6);
        assert_eq!(count(&Truth::is_alien), 3);
        assert_eq!(count(&|truth| truth.effects.len() == 2), 4);
        assert!(trials[..20].iter().any(|t| t.truth.is_clean() || t.truth.effects.len() == 2));
        let names: BTreeSet<_> = trials.iter().map(|t| &t.name).collect();
        assert_eq!(names.len(), trials.len());
    }

    #[test]
    fn thirty_single_trials_cover_the_whole_table() {
        let trials = draw(Mix { double: 0, clean: 0, alien: 0, ..MIX }, 1);
        let ids: BTreeSet<_> = trials.iter().map(|t| t.truth.effects[0].id.clone()).collect();
        assert_eq!(ids.len(), strengths(Family::World).0.len());
        let strengths = trials.iter().map(|t| t.truth.effects[0].strength);
        assert!(strengths.into_iter().all(|s| (1.0..=4.0).contains(&s)));
    }

    #[test]
    fn two_effects_of_a_trial_differ() {
        for seed in 0..40 {
            for trial in draw(Mix { single: 0, double: 3, clean: 0, alien: 0, ..MIX }, seed) {
                assert_ne!(trial.truth.effects[0].id, trial.truth.effects[1].id);
            }
        }
    }
}
