//! Counts over all judgements.

use super::judge::Judgement;
use evrig_core::stats::{median, wilson95};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A proportion with its 95 % confidence interval (Wilson).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct CountedShare {
    /// How many.
    pub hits: u64,
    /// Of how many.
    pub of: u64,
    /// The interval of the share.
    pub ci95: [f64; 2],
}

impl CountedShare {
    fn count<T>(items: impl IntoIterator<Item = T>, is_hit: impl Fn(&T) -> bool) -> Self {
        let (mut hits, mut of) = (0, 0);
        for item in items {
            of += 1;
            hits += u64::from(is_hit(&item));
        }
        Self { hits, of, ci95: wilson95(hits, of) }
    }

    /// Hits over all; `NaN` when nothing was counted.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.hits as f64 / self.of as f64
    }
}

impl std::fmt::Display for CountedShare {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.of == 0 {
            return write!(f, "none");
        }
        let [low, high] = self.ci95.map(|v| 100.0 * v);
        write!(f, "{}/{} ({:.0} %, {low:.0}..{high:.0})", self.hits, self.of, 100.0 * self.value())
    }
}

/// One effect over all trials with it alone.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PerEffect {
    /// Named first.
    pub top1: CountedShare,
    /// Named first, stated equivalents counted.
    pub top1_or_equivalent: CountedShare,
    /// Named first, among strengths below two and from two on.
    pub by_strength: [CountedShare; 2],
    /// What was named first instead, and how often; `nothing` when nothing was.
    pub instead: BTreeMap<String, u64>,
}

/// Verdicts without an answer.
const UNANSWERED: &[&str] = &["failed", "out_of_time"];

/// Levels of an interval with their half-width in that of the 90 % one, for normal errors.
const LEVELS: &[(f64, f64)] =
    &[(0.5, 0.4101), (0.68, 0.6046), (0.8, 0.7791), (0.9, 1.0), (0.95, 1.1916), (0.99, 1.5660)];

/// Score of the diagnosis over a set of trials.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ProofScore {
    /// Trials judged.
    pub n: u64,
    /// Trials with one effect of the library: it was named first.
    pub top1: CountedShare,
    /// The same, stated equivalents counted.
    pub top1_or_equivalent: CountedShare,
    /// The same for those at twice the least strength and above.
    pub top1_from_strength_2: CountedShare,
    /// The same for those whose effect the answer does not say it cannot judge.
    pub top1_of_judged: CountedShare,
    /// Named first by strength: below the square root of two, two, its double, and above.
    pub by_strength: [CountedShare; 4],
    /// What was named first, by what was hidden alone; `nothing` on either side is nothing.
    pub confusion: BTreeMap<String, BTreeMap<String, u64>>,
    /// F1 of the sets named, over trials with two effects or more; stated equivalents count.
    pub set_f1: Option<f64>,
    /// Clean trials in which something was named.
    pub false_discovery: CountedShare,
    /// Trials with an effect outside the library that were called unexplained or partly explained
    /// and in which nothing was named.
    pub abstained: CountedShare,
    /// Trials with effects of the library that were called unexplained.
    pub false_abstention: CountedShare,
    /// Median of the parameters' relative errors.
    pub median_parameter_error: Option<f64>,
    /// Stated 90 % intervals that hold the truth.
    pub coverage90: CountedShare,
    /// Claimed level, and the share of intervals widened or narrowed to it that hold the truth.
    pub calibration: Vec<(f64, CountedShare)>,
    /// Median share of the excess removed, in trials whose effects were all named.
    pub median_share_removed: Option<f64>,
    /// Mean overlap of regions.
    pub mean_region_f1: Option<f64>,
    /// Trials without an answer: refused, or out of time.
    pub unanswered: u64,
    /// Median seconds of a diagnosis.
    pub median_diagnosed_s: Option<f64>,
    /// Each effect.
    pub effects: BTreeMap<String, PerEffect>,
}

impl ProofScore {
    /// Counts judgements.
    #[must_use]
    pub fn of(judgements: &[Judgement]) -> Self {
        let all = || judgements.iter();
        let in_library = || all().filter(|j| !j.is_outside_library && !j.hidden.is_empty());
        // A regional effect is scored by its region, not counted among the others.
        let single = || in_library().filter(|j| j.hidden.len() == 1 && j.region_f1.is_none());
        let parameters = || all().flat_map(|j| &j.parameters);
        let removed = in_library().filter(|j| j.missed == 0).filter_map(|j| j.share_removed);
        let regions: Vec<f64> = all().filter_map(|j| j.region_f1).collect();
        let n_regions = regions.len() as f64;
        Self {
            n: judgements.len() as u64,
            top1: CountedShare::count(single(), |j| j.is_top1),
            top1_or_equivalent: CountedShare::count(single(), |j| j.is_top1_or_equivalent),
            top1_from_strength_2: CountedShare::count(
                single().filter(|j| j.strengths[0] >= 2.0),
                |j| j.is_top1,
            ),
            top1_of_judged: CountedShare::count(
                single().filter(|j| !j.is_declared_undecidable),
                |j| j.is_top1,
            ),
            by_strength: [0, 1, 2, 3].map(|bin| {
                let of_bin = |j: &&Judgement| strength_bin(j.strengths[0]) == bin;
                CountedShare::count(single().filter(of_bin), |j| j.is_top1)
            }),
            confusion: confusion(all().filter(|j| j.hidden.len() < 2 && j.region_f1.is_none())),
            set_f1: set_f1(in_library().filter(|j| j.hidden.len() > 1)),
            false_discovery: CountedShare::count(all().filter(|j| j.hidden.is_empty()), |j| {
                j.wrong > 0
            }),
            abstained: CountedShare::count(all().filter(|j| j.is_outside_library), |j| {
                let seen = ["unexplained", "partly_explained"].contains(&j.verdict.as_str());
                j.named.is_empty() && seen
            }),
            false_abstention: CountedShare::count(in_library(), |j| j.verdict == "unexplained"),
            median_parameter_error: median(parameters().map(|p| p.relative_error)),
            coverage90: CountedShare::count(parameters().filter_map(|p| p.is_covered), |&is| is),
            calibration: LEVELS
                .iter()
                .map(|&(level, intervals)| {
                    let errors = parameters().filter_map(|p| p.error_in_intervals);
                    (level, CountedShare::count(errors, |&error| error <= intervals))
                })
                .collect(),
            median_share_removed: median(removed),
            mean_region_f1: (n_regions > 0.0).then(|| regions.iter().sum::<f64>() / n_regions),
            unanswered: all().filter(|j| UNANSWERED.contains(&j.verdict.as_str())).count() as u64,
            median_diagnosed_s: median(all().map(|j| j.diagnosed_s)),
            effects: per_effect(&single().collect::<Vec<_>>()),
        }
    }
}

fn set_f1<'a>(judgements: impl Iterator<Item = &'a Judgement>) -> Option<f64> {
    let add =
        |sum: [usize; 3], j: &Judgement| [sum[0] + j.right, sum[1] + j.wrong, sum[2] + j.missed];
    let [right, wrong, missed] = judgements.fold([0; 3], add);
    let n = 2 * right + wrong + missed;
    (n > 0).then(|| 2.0 * right as f64 / n as f64)
}

/// Four bins, even in the logarithm from one to four.
fn strength_bin(strength: f64) -> usize {
    (2.0 * strength.log2()).floor().clamp(0.0, 3.0) as usize
}

fn confusion<'a>(
    judgements: impl Iterator<Item = &'a Judgement>,
) -> BTreeMap<String, BTreeMap<String, u64>> {
    let mut counts: BTreeMap<String, BTreeMap<String, u64>> = BTreeMap::new();
    for judgement in judgements {
        let hidden = judgement.hidden.first().map_or("nothing", String::as_str);
        *counts.entry(hidden.to_owned()).or_default().entry(first_word(judgement)).or_insert(0) +=
            1;
    }
    counts
}

/// The first name, or the verdict in its place.
fn first_word(judgement: &Judgement) -> String {
    let verdict = match judgement.verdict.as_str() {
        "no_mismatch" => "nothing",
        other => other,
    };
    judgement.named.first().map_or(verdict, String::as_str).to_owned()
}

fn per_effect(single: &[&Judgement]) -> BTreeMap<String, PerEffect> {
    let mut by_id: BTreeMap<String, Vec<&Judgement>> = BTreeMap::new();
    for judgement in single {
        by_id.entry(judgement.hidden[0].clone()).or_default().push(judgement);
    }
    let one = |trials: Vec<&Judgement>| {
        let mut instead = BTreeMap::new();
        for trial in trials.iter().filter(|trial| !trial.is_top1) {
            *instead.entry(first_word(trial)).or_insert(0) += 1;
        }
        let split = |strong: bool| {
            let part = trials.iter().filter(|j| (j.strengths[0] >= 2.0) == strong);
            CountedShare::count(part, |j| j.is_top1)
        };
        PerEffect {
            top1: CountedShare::count(&trials, |j| j.is_top1),
            top1_or_equivalent: CountedShare::count(&trials, |j| j.is_top1_or_equivalent),
            by_strength: [split(false), split(true)],
            instead,
        }
    };
    by_id.into_iter().map(|(id, trials)| (id, one(trials))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judgement(hidden: &[&str], named: &[&str], strength: f64) -> Judgement {
        let right = named.iter().filter(|id| hidden.contains(id)).count();
        Judgement {
            trial: "t".into(),
            hidden: hidden.iter().map(|id| (*id).to_owned()).collect(),
            strengths: vec![strength; hidden.len()],
            named: named.iter().map(|id| (*id).to_owned()).collect(),
            verdict: if named.is_empty() { "no_mismatch" } else { "explained" }.into(),
            is_top1: named.first().is_some_and(|id| hidden.contains(id)),
            is_top1_or_equivalent: named.first().is_some_and(|id| hidden.contains(id)),
            right,
            wrong: named.len() - right,
            missed: hidden.iter().filter(|id| !named.contains(id)).count(),
            parameters: Vec::new(),
            region_f1: None,
            share_removed: None,
            first_gain: None,
            is_outside_library: hidden.contains(&"alien"),
            is_declared_undecidable: false,
            diagnosed_s: 3.0,
        }
    }

    #[test]
    fn kinds_of_trials_are_counted_apart() {
        let score = ProofScore::of(&[
            judgement(&["flicker"], &["flicker"], 3.0),
            judgement(&["flicker"], &["vibration"], 1.5),
            judgement(&["defocus"], &[], 1.2),
            judgement(&[], &[], 0.0),
            judgement(&[], &["flicker"], 0.0),
            judgement(&["alien"], &["flicker"], 2.0),
            judgement(&["flicker", "defocus"], &["flicker", "vibration"], 2.0),
        ]);
        assert_eq!((score.top1.hits, score.top1.of), (1, 3));
        assert_eq!((score.top1_from_strength_2.hits, score.top1_from_strength_2.of), (1, 1));
        assert_eq!((score.false_discovery.hits, score.false_discovery.of), (1, 2));
        assert_eq!((score.abstained.hits, score.abstained.of), (0, 1));
        assert_eq!(score.set_f1, Some(0.5));
        assert_eq!(score.effects["flicker"].instead["vibration"], 1);
        assert_eq!(score.effects["defocus"].instead["nothing"], 1);
        assert_eq!(
            score.confusion["nothing"],
            [("flicker".into(), 1), ("nothing".into(), 1)].into()
        );
        assert_eq!(score.confusion["alien"]["flicker"], 1);
        assert_eq!(score.by_strength.map(|share| share.of), [1, 1, 0, 1]);
    }

    #[test]
    fn an_alien_is_abstained_from_only_when_a_mismatch_was_seen() {
        let mut seen = judgement(&["alien"], &[], 2.0);
        let silent = seen.clone();
        let mut late = silent.clone();
        seen.verdict = "unexplained".into();
        late.verdict = "out_of_time".into();
        let score = ProofScore::of(&[seen, silent, late]);
        assert_eq!((score.abstained.hits, score.abstained.of), (1, 3));
        assert_eq!(score.unanswered, 1);
    }

    #[test]
    fn honest_intervals_are_calibrated_at_every_level_and_narrow_ones_at_none() {
        let mut random = evrig_core::stats::SplitMix::new(4, 0);
        let checked = |scale: f64, random: &mut evrig_core::stats::SplitMix| {
            let mut judgement = judgement(&["flicker"], &["flicker"], 2.0);
            // Normal errors in units of the 90 % half-width.
            let mut check = || scale * random.normal().abs() / 1.6449;
            judgement.parameters = (0..2_000)
                .map(|_| super::super::ParameterCheck {
                    id: "flicker".into(),
                    key: "depth".into(),
                    truth: 1.0,
                    value: 1.0,
                    relative_error: 0.0,
                    is_covered: None,
                    error_in_intervals: Some(check()),
                })
                .collect();
            ProofScore::of(&[judgement]).calibration
        };
        for (level, share) in checked(1.0, &mut random) {
            // 2000 draws: five standard errors.
            assert!((share.value() - level).abs() < 0.056, "{level}: {share}");
        }
        assert!(checked(3.0, &mut random).iter().all(|(level, share)| share.value() < level - 0.2));
    }

    #[test]
    fn a_share_is_shown_with_its_interval() {
        let share = CountedShare::count([true, true, true, false], |&hit| hit);
        assert_eq!(share.to_string(), "3/4 (75 %, 30..95)");
        assert_eq!(CountedShare::count([true; 0], |&hit| hit).to_string(), "none");
    }
}
