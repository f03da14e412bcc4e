//! A plan of trials, drawn from a seed.

use super::strength::{StrengthScale, strengths};
use super::truth::{ConcealedEffect, ConcealedTrial, Family, SealedTruth};
use evrig_core::effect_id::EffectGroup;
use evrig_core::geometry::Rectangle;
use evrig_core::stats::SplitMix;
use serde::{Deserialize, Serialize};

/// The strongest an effect is drawn, in units of its least strength.
const STRONGEST: f64 = 4.0;

/// How many trials of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrialMix {
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
    /// With one effect in a part of the image only.
    pub local: usize,
}

impl TrialMix {
    /// No trial of any kind.
    #[must_use]
    pub const fn none(family: Family) -> Self {
        Self { family, single: 0, double: 0, clean: 0, alien: 0, local: 0 }
    }
}

/// What a trial is to hide.
#[derive(Clone, Default)]
struct TrialKind<'a> {
    effects: Vec<&'a StrengthScale>,
    is_local: bool,
}

/// Columns and rows of the simulated rig's event camera.
const SENSOR_PX: [u16; 2] = [346, 260];

/// Columns and rows between which the moving target is mostly visible: pixels beside it are not
/// judged, so a region has to divide the target and not the sensor.
const TARGET_PX: [[u16; 2]; 2] = [[130, 300], [50, 210]];

/// Images and trajectories of the simulated rig that trials take in turn.
const IMAGES: &[&str] = &["leaves-1", "leaves-2", "leaves-3", "leaves-4"];
const TRAJECTORIES: &[&str] = &["circle", "figure-eight"];

/// Draws the trials of a mix: the same seed gives the same trials.
#[must_use]
pub fn draw(mix: TrialMix, seed: u64) -> Vec<ConcealedTrial> {
    let (known, alien) = strengths(mix.family);
    let mut kinds: Vec<TrialKind<'_>> = Vec::new();
    let whole = |effects| TrialKind { effects, is_local: false };
    let mut order = SplitMix::new(seed, u64::MAX);
    // One after another from a shuffled table, so that few trials still cover many effects.
    let deck = shuffled(known.len(), &mut order);
    let pick = |i: usize| (!deck.is_empty()).then(|| &known[deck[i % deck.len()]]);
    kinds.extend((0..mix.single).filter_map(|i| pick(i).map(|s| whole(vec![s]))));
    kinds.extend((0..mix.double).filter_map(|_| pair(known, &mut order).map(whole)));
    kinds.extend((0..mix.clean).map(|_| TrialKind::default()));
    let first = order.below(alien.len().max(1));
    kinds.extend(
        (0..mix.alien)
            .filter_map(|i| alien.get((first + i) % alien.len().max(1)))
            .map(|s| whole(vec![s])),
    );
    let placeable: Vec<&StrengthScale> = known.iter().filter(|entry| is_placeable(entry)).collect();
    let first = order.below(placeable.len().max(1));
    kinds.extend(
        (0..mix.local)
            .filter_map(|i| placeable.get((first + i) % placeable.len().max(1)))
            .map(|s| TrialKind { effects: vec![s], is_local: true }),
    );
    let kinds = shuffled(kinds.len(), &mut order).into_iter().map(|i| kinds[i].clone());
    kinds.enumerate().map(|(number, kind)| trial(mix.family, number, &kind, seed)).collect()
}

/// Effects that the world can limit to a part of its pixels and that act in each of them.
fn is_placeable(entry: &StrengthScale) -> bool {
    let acts_in_each = !["hot_pixels", "threshold_mismatch"].contains(&entry.id);
    let effect = entry.id.parse::<evrig_core::effect_id::EffectId>();
    acts_in_each && effect.is_ok_and(|effect| effect.group() == EffectGroup::Pixel)
}

/// One side of the sensor, with between two and three fifths of the columns and rows in which the
/// target is visible.
fn part_of(random: &mut SplitMix) -> Rectangle {
    let mut ends = SENSOR_PX.map(|n| [0, n]);
    let axis = random.below(2);
    let [from, to] = TARGET_PX[axis].map(f64::from);
    let cut = (from + (to - from) * random.between(0.4, 0.6)).round() as u16;
    ends[axis] = if random.below(2) == 0 { [0, cut] } else { [cut, SENSOR_PX[axis]] };
    let [x_px, y_px] = ends;
    Rectangle { x_px, y_px }
}

fn pair<'a>(known: &'a [StrengthScale], random: &mut SplitMix) -> Option<Vec<&'a StrengthScale>> {
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

fn trial(family: Family, number: usize, kind: &TrialKind<'_>, seed: u64) -> ConcealedTrial {
    let mut random = SplitMix::new(seed, number as u64);
    // Where an effect is, is asked of effects that can be seen.
    let weakest: f64 = if kind.is_local { 2.0 } else { 1.0 };
    let effects = kind
        .effects
        .iter()
        .map(|entry| {
            // Even in the logarithm: as many trials between 1 and 2 as between 2 and 4.
            let strength = weakest * (STRONGEST / weakest).powf(random.uniform());
            ConcealedEffect {
                id: entry.id.into(),
                parameters: entry.parameters(strength),
                strength,
            }
        })
        .collect();
    let (mut image, mut trajectory) = (String::new(), String::new());
    if family == Family::World {
        image = IMAGES[random.below(IMAGES.len())].into();
        trajectory = TRAJECTORIES[random.below(TRAJECTORIES.len())].into();
    }
    let nonce = format!("{:016x}{:016x}", random.bits(), random.bits());
    let region = kind.is_local.then(|| part_of(&mut random));
    let truth = SealedTruth { schema: "evrig.truth/1".into(), effects, region, nonce };
    let name = format!("{}-{number:03}", family.as_str());
    ConcealedTrial { name, family, image, trajectory, seed: random.bits(), truth }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    const MIX: TrialMix =
        TrialMix { family: Family::World, single: 30, double: 4, clean: 6, alien: 3, local: 0 };

    #[test]
    fn a_seed_draws_the_same_trials_and_another_seed_others() {
        assert_eq!(draw(MIX, 3), draw(MIX, 3));
        assert_ne!(draw(MIX, 3), draw(MIX, 4));
    }

    #[test]
    fn the_kinds_are_as_many_as_asked_for_and_in_no_order() {
        let trials = draw(MIX, 8);
        let count =
            |test: &dyn Fn(&SealedTruth) -> bool| trials.iter().filter(|t| test(&t.truth)).count();
        assert_eq!(trials.len(), 43);
        assert_eq!(count(&SealedTruth::is_clean), 6);
        assert_eq!(count(&SealedTruth::is_outside_library), 3);
        assert_eq!(count(&|truth| truth.effects.len() == 2), 4);
        assert!(trials[..20].iter().any(|t| t.truth.is_clean() || t.truth.effects.len() == 2));
        let names: BTreeSet<_> = trials.iter().map(|t| &t.name).collect();
        assert_eq!(names.len(), trials.len());
    }

    #[test]
    fn thirty_single_trials_cover_the_whole_table() {
        let trials = draw(TrialMix { single: 30, ..TrialMix::none(Family::World) }, 1);
        let ids: BTreeSet<_> = trials.iter().map(|t| t.truth.effects[0].id.clone()).collect();
        assert_eq!(ids.len(), strengths(Family::World).0.len());
        let strengths = trials.iter().map(|t| t.truth.effects[0].strength);
        assert!(strengths.into_iter().all(|s| (1.0..=4.0).contains(&s)));
    }

    #[test]
    fn two_effects_of_a_trial_differ() {
        for seed in 0..40 {
            for trial in draw(TrialMix { double: 3, ..TrialMix::none(Family::World) }, seed) {
                assert_ne!(trial.truth.effects[0].id, trial.truth.effects[1].id);
            }
        }
    }

    #[test]
    fn an_effect_in_a_part_of_the_image_is_strong_and_the_part_is_about_half() {
        let rig = evrig_session::rig::Rig::simulated().unwrap();
        let size = rig.davis.camera.size;
        assert_eq!([size.width, size.height], SENSOR_PX);
        for trial in draw(TrialMix { local: 40, ..TrialMix::none(Family::World) }, 2) {
            let region = trial.truth.region.unwrap();
            let within = |px: [u16; 2], print: [u16; 2]| {
                let length = |[a, b]: [u16; 2]| f64::from(b) - f64::from(a);
                length([px[0].max(print[0]), px[1].min(print[1])]) / length(print)
            };
            let share = within(region.x_px, TARGET_PX[0]) * within(region.y_px, TARGET_PX[1]);
            assert!((0.39..=0.61).contains(&share), "{share}");
            assert!((2.0..=4.0).contains(&trial.truth.effects[0].strength));
        }
    }
}
