//! What a pixel compares with.
//!
//! Mostly that is one value. Where something happened unseen (behind an event a filter took events
//! out, or an event came about behind the pixel) several are possible, each with its weight.

mod memorise;

use super::course::{Course, Reach};
use super::mask::behind_mask;
use super::movement::Movement;
use super::softplus::{logistic, softplus};
use super::threshold::Threshold;
pub(super) use memorise::{MOST_CARRIED, fresh};

/// A case less likely than this is forgotten.
pub(super) const LEAST_WEIGHT: f64 = 2e-3;

/// Cases whose values differ by less of a threshold are one.
const ALIKE: f64 = 0.02;

/// Most cases that are kept side by side.
pub(super) const MOST_CASES: usize = 4;

/// Where the signal has come to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Here {
    pub(super) height: f64,
    /// Change a second.
    pub(super) speed: f64,
    /// How much of its rate the signal's own noise has again.
    pub(super) rested: f64,
}

/// One way in which a pixel may stand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Case {
    pub(super) weight: f64,
    /// Height of the signal that it compares with.
    pub(super) value: f64,
    /// How far from it the signal had gone without an event, On and Off, when the case began: what the
    /// thresholds spent up to there counts no more.
    pub(super) begin: [f64; 2],
    /// How far it had gone before the reach that is counted now.
    pub(super) gone: [f64; 2],
    pub(super) thresholds: [Threshold; 2],
    pub(super) noise: f64,
    /// What the noise's own movement has spent since the case began, On and Off.
    pub(super) moved: [f64; 2],
}

impl Case {
    /// Of a pixel that memorised `value`, thresholds scattered by `noise`.
    pub(super) fn new(course: &Course<'_>, value: f64, noise: f64) -> Self {
        let law = course.law;
        let threshold = |theta| Threshold::new(theta, noise, law.drop_fraction);
        let thresholds = [threshold(law.theta_on), threshold(law.theta_off)];
        Self {
            weight: 1.0,
            value,
            begin: [0.0; 2],
            gone: [0.0; 2],
            thresholds,
            noise,
            moved: [0.0; 2],
        }
    }

    /// Greatest change without an event, On and Off.
    pub(super) fn gone(&self, reach: Reach) -> [f64; 2] {
        [(reach.high - self.value).max(self.gone[0]), (self.value - reach.low).max(self.gone[1])]
    }

    /// Change at a height, towards On or Off.
    pub(super) fn change(&self, height: f64, on: bool) -> f64 {
        if on { height - self.value } else { self.value - height }
    }

    /// What the thresholds had spent when the case began.
    pub(super) fn spent_before(&self, side: usize) -> f64 {
        self.thresholds[side].spent(self.begin[side])
    }

    /// The same, which the signal had `gone` without an event, from where it is.
    pub(super) fn begun_at(self, gone: [f64; 2]) -> Self {
        Self { begin: gone, gone, moved: [0.0; 2], ..self }
    }

    fn spent(&self, reach: Reach) -> [f64; 2] {
        let gone = self.gone(reach);
        [0, 1].map(|side| {
            self.thresholds[side].silence(self.begin[side], gone[side]) + self.moved[side]
        })
    }

    /// Hazard, a second, of events that the light or the noise sets off where the signal comes to a height
    /// at a speed.
    fn sets_off(&self, course: &Course<'_>, on: bool, reach: Reach, here: Here) -> f64 {
        let Here { height, speed, rested } = here;
        let side = usize::from(!on);
        let (slope, gone) = (if on { speed } else { -speed }, self.gone(reach)[side]);
        let is_new = slope > 0.0 && self.change(height, on) >= gone;
        let threshold = self.thresholds[side];
        let crosses = if is_new { threshold.hazard(self.begin[side], gone) * slope } else { 0.0 };
        let moves = self.movement(course);
        crosses
            + moves.map_or(0.0, |moves| moves.hazard(self.change(height, on), speed, on, rested))
    }

    pub(super) fn movement(&self, course: &Course<'_>) -> Option<Movement> {
        Movement::new(course.law, self.noise)
    }
}

/// A memory of which nothing is known: it lies anywhere between the thresholds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unknown {
    /// Height of the signal where the stretch began.
    pub(super) value: f64,
    /// Scale of the thresholds' scatter.
    noise: f64,
    /// Both thresholds.
    sum: f64,
}

impl Unknown {
    /// At the begin of a stretch of light.
    pub(super) fn new(course: &Course<'_>, position: f64) -> Self {
        let law = course.law;
        let grown = law.noise(course.level(position));
        // Noise of the signal brings either threshold as near.
        let noise = grown.max(law.shot(grown));
        Self { value: course.height(position), noise, sum: law.theta_on + law.theta_off }
    }

    /// Chance that nothing fires until both extremes of the signal lie `span` apart.
    fn left(&self, span: f64) -> f64 {
        softplus((self.sum - span) / self.noise) / softplus(self.sum / self.noise)
    }

    /// The span of the extremes at which that chance has fallen to `left`.
    pub(super) fn span_at(&self, left: f64) -> f64 {
        let softened = softplus(self.sum / self.noise) * left;
        self.sum - self.noise * softened.exp_m1().max(1e-300).ln()
    }

    /// Hazard per unit of height at a height that the signal has just come to.
    fn hazard(&self, on: bool, reach: Reach, height: f64) -> f64 {
        let is_new = if on { height >= reach.high } else { height <= reach.low };
        let z = (self.sum - (reach.high - reach.low)) / self.noise;
        let hazard = logistic(z) / (self.noise * softplus(z).max(1e-300));
        if is_new { hazard } else { 0.0 }
    }
}

/// What the pixel compares with: one of some cases, whose weights add up to one, the likeliest first;
/// mostly there is but one.
#[derive(Debug)]
pub(super) struct Memory {
    cases: Vec<Case>,
    /// While nothing is known, and there are no cases.
    unknown: Option<Unknown>,
    /// For cases that are made of others.
    spare: Vec<Case>,
    /// How many are kept.
    most: usize,
}

/// An event, as far as it changes what the pixel compares with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fired {
    pub(super) t_us: f64,
    pub(super) on: bool,
    /// Chance that it was background.
    pub(super) background_share: f64,
}

impl Memory {
    /// Of a pixel of whose past nothing is known.
    pub(super) fn unknown(course: &Course<'_>, unknown: Unknown) -> Self {
        let most = course.law.n_memories();
        Self { cases: Vec::new(), unknown: Some(unknown), spare: Vec::new(), most }
    }

    /// The cases; none while nothing is known.
    pub(super) fn cases(&self) -> &[Case] {
        &self.cases
    }

    /// The cases, for what the noise's own movement spends in each.
    pub(super) fn cases_mut(&mut self) -> &mut [Case] {
        &mut self.cases
    }

    /// Weighs the cases anew by how likely each was to stay silent while the signal went so far. To
    /// be asked just before an event: what was spent until then must not be asked any more.
    pub(super) fn weigh(&mut self, reach: Reach) {
        if self.cases.len() > 1 {
            for case in &mut self.cases {
                let [on, off] = case.spent(reach);
                case.weight *= (-on - off).exp();
            }
            normalise(&mut self.cases, self.most);
        }
    }

    /// What the signal's way has spent, On and Off. Several cases share one store, which is booked to
    /// the side that spent more of them.
    pub(super) fn spent(&self, reach: Reach) -> [f64; 2] {
        if let Some(unknown) = &self.unknown {
            let [up, down] = [reach.high - unknown.value, unknown.value - reach.low];
            return booked(unknown.left(up + down), [up, down]);
        }
        if let [only] = self.cases.as_slice() {
            return only.spent(reach);
        }
        let (mut left, mut sides) = (0.0, [0.0; 2]);
        for case in &self.cases {
            let [on, off] = case.spent(reach);
            left += case.weight * (-on - off).exp();
            sides = [sides[0] + case.weight * on, sides[1] + case.weight * off];
        }
        booked(left, sides)
    }

    /// Hazard, a second, of events that the light or the noise sets off where the signal has just come to
    /// a height at a speed; cases weighed.
    pub(super) fn sets_off(&self, course: &Course<'_>, on: bool, reach: Reach, here: Here) -> f64 {
        if let Some(unknown) = &self.unknown {
            let slope = if on { here.speed } else { -here.speed };
            return unknown.hazard(on, reach, here.height) * slope.max(0.0);
        }
        self.cases.iter().map(|case| case.weight * case.sets_off(course, on, reach, here)).sum()
    }

    /// Gives the cases away; others are to be set in their place.
    pub(super) fn take(&mut self) -> Vec<Case> {
        std::mem::take(&mut self.cases)
    }

    /// Takes other cases in the place of these.
    pub(super) fn set(&mut self, cases: Vec<Case>) {
        self.cases = cases;
        normalise(&mut self.cases, self.most);
    }

    /// Change at a height towards On or Off against what the pixel most likely compares with.
    pub(super) fn change(&self, height: f64, on: bool) -> Option<f64> {
        self.cases.first().map(|likeliest| likeliest.change(height, on))
    }

    /// The pixel has fired: what it compares with from the end of the blind time on; `end_us` ends the
    /// known light. Cases weighed.
    pub(super) fn fire(&mut self, course: &Course<'_>, fired: Fired, reach: Reach, end_us: f64) {
        let law = course.law;
        let passed_by = fired.background_share * (1.0 - law.background_memorised);
        self.memorise(course, fired, reach, end_us);
        self.unknown = None;
        let mut reach = reach;
        if passed_by < LEAST_WEIGHT {
            self.cases.clear();
        } else if law.drop_fraction > 0.0 {
            let at = course.position(fired.t_us);
            self.part(course, reach, at);
            reach = Reach::at(course.height(at));
        }
        for case in &mut self.cases {
            *case = case.begun_at(case.gone(reach));
            case.weight *= passed_by;
        }
        // Of a memory that is not known nothing is kept.
        let weight = if self.cases.is_empty() { 1.0 } else { 1.0 - passed_by };
        self.cases.extend(
            self.spare.iter().map(|fresh| Case { weight: weight * fresh.weight, ..*fresh }),
        );
        let masked_us = law.masked_s * 1e6;
        if masked_us > 0.0 {
            let [at, to] =
                [fired.t_us, (fired.t_us + masked_us).min(end_us)].map(|us| course.position(us));
            self.spare.clear();
            for case in &self.cases {
                behind_mask(course, case, [at, to], &mut self.spare);
            }
            std::mem::swap(&mut self.cases, &mut self.spare);
        }
        normalise(&mut self.cases, self.most);
    }
}

/// Adds a case to some; where one compares with all but the same value the two are one.
pub(super) fn gather(cases: &mut Vec<Case>, other: Case) {
    let alike = ALIKE * other.thresholds[0].theta();
    match cases.iter_mut().find(|case| (case.value - other.value).abs() < alike) {
        None => cases.push(other),
        Some(case) if case.weight >= other.weight => case.weight += other.weight,
        Some(case) => *case = Case { weight: case.weight + other.weight, ..other },
    }
}

/// Keeps the likeliest cases, likeliest first, with weights that add up to one.
fn normalise(cases: &mut Vec<Case>, most: usize) {
    if let [only] = cases.as_mut_slice() {
        only.weight = 1.0;
        return;
    }
    cases.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let all: f64 = cases.iter().map(|case| case.weight).sum();
    let least = LEAST_WEIGHT * all;
    let kept = cases.iter().take(most).take_while(|case| case.weight >= least).count();
    cases.truncate(kept.max(1));
    let sum: f64 = cases.iter().map(|case| case.weight).sum();
    let n = cases.len() as f64;
    for case in cases {
        case.weight = if sum > 0.0 { case.weight / sum } else { 1.0 / n };
    }
}

/// What was spent in all when the share `left` survives, parted as `sides` are.
fn booked(left: f64, sides: [f64; 2]) -> [f64; 2] {
    let all = -left.max(1e-300).ln();
    let sum = sides[0] + sides[1];
    let share = if sum > 0.0 { sides[0] / sum } else { 0.5 };
    [all * share, all * (1.0 - share)]
}
