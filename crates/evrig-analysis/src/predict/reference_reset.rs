//! What a pixel compares with that has just memorised at an event.

use super::super::PixelLaw;
use super::super::course::{Course, Reach};
use super::{Case, Fired, Here, LEAST_WEIGHT, MOST_CASES, Memory, gather};

/// A case less likely than this to have set off an event did not.
const LEAST_SHARE: f64 = 0.02;

/// Most cases that may have carried noise of unknown size.
pub(in crate::predict) const MOST_CARRIED: usize = 4;

/// Most cases that stand side by side, under any law.
const MOST: usize = if MOST_CARRIED > MOST_CASES { MOST_CARRIED } else { MOST_CASES };

/// Noise of the signal that may have set off an event of which nothing else is known, in its standard
/// deviations, with the chance of each.
const CARRIED: [[f64; 2]; MOST_CARRIED] = [[0.6, 0.22], [1.2, 0.33], [1.8, 0.28], [2.5, 0.17]];

/// The same, in fewer cases.
const CARRIED_ASTRAY: [[f64; 2]; 3] = [[0.8, 0.3], [1.5, 0.4], [2.2, 0.3]];

/// No scatter is so many of its scales, but by a chance of one in a thousand.
const MOST_SCATTER: f64 = 7.0;

/// Chance that what a pixel is taken to compare with has nothing to do with what it does.
const ASTRAY: f64 = 0.02;

impl Memory {
    /// Into `spare`, what the pixel compares with if it memorised at an event: where the noise that set it
    /// off is memorised, that depends on what it compared with before.
    pub(super) fn memorise(
        &mut self,
        course: &Course<'_>,
        fired: Fired,
        reach: Reach,
        end_us: f64,
    ) {
        let at = course.position(fired.t_us);
        let here = Here { height: course.height(at), speed: course.slope(at), rested: 1.0 };
        let fresh = |case: Option<&Case>| {
            fresh(course, fired, case.map(|case| case.change(here.height, fired.on)), end_us)
        };
        self.spare.clear();
        let is_shot = course.law.shot_at_white > 0.0;
        if is_shot {
            // What is followed may have gone astray: at once where the event is not understood.
            let astray = fired.background_share.max(ASTRAY);
            let (share, noise): (f64, &[[f64; 2]]) =
                if self.cases.is_empty() { (1.0, &CARRIED) } else { (astray, &CARRIED_ASTRAY) };
            let plain = Case { weight: share, ..fresh(None) };
            self.spare.extend(carried(course, fired, plain, noise));
            self.cases.iter_mut().for_each(|case| case.weight *= 1.0 - share);
        } else if self.cases.len() < 2 || course.law.noise_memorised <= 0.0 {
            self.spare.push(fresh(self.cases.first()));
            return;
        }
        let mut shares = [0.0; MOST];
        for (share, case) in shares.iter_mut().zip(&self.cases) {
            *share = case.weight * case.sets_off(course, fired.on, reach, here);
        }
        let all: f64 = shares.iter().sum();
        let left: f64 = self.cases.iter().map(|case| case.weight).sum();
        // Of noise that is carried on and on even what is unlikely may turn out.
        let least = if is_shot { LEAST_WEIGHT } else { LEAST_SHARE };
        for (case, set_off) in self.cases.iter().zip(shares) {
            let weight = left * if all > 0.0 { set_off / all } else { case.weight };
            if weight >= least {
                gather(&mut self.spare, Case { weight, ..fresh(Some(case)) });
            }
        }
    }
}

/// What a pixel compares with that has memorised at an event; `change` is what had brought it there.
pub(in crate::predict) fn fresh(
    course: &Course<'_>,
    fired: Fired,
    change: Option<f64>,
    end_us: f64,
) -> Case {
    let law = course.law;
    let position = course.position((fired.t_us + law.blind_s * 1e6).min(end_us));
    let height = course.height(position);
    let mut value = height;
    let mut scatter = course.scatter_of_stamp(position);
    if let Some(change) = change.filter(|_| law.noise_memorised > 0.0 || law.stamps_are_weighed) {
        // Of what was missing to the threshold, or to its multiple where events were lost, noise was memorised
        // with the light; and where the stamp is off the event, the pixel memorised what it had come to then.
        let noise = law.noise(course.level(position));
        let (missing, all) = (missing(law, fired, change), scatter.hypot(noise));
        // What neither can have made says that the memory has gone astray: the stamp knows better. Behind a
        // dead time the pixel memorises what no threshold has told.
        let is_told =
            law.stamps_are_weighed && law.blind_s <= 0.0 && missing.abs() <= MOST_SCATTER * all;
        let off = if is_told { (scatter / all.max(1e-300)).powi(2) } else { 0.0 };
        let other = 1.0 - law.noise_memorised;
        value += missing * (law.noise_memorised + other * off);
        scatter *= other * (1.0 - off).sqrt();
    }
    // It fired at this height, so it did not fire on the way from what it memorised to here.
    let gone = [(height - value).max(0.0), (value - height).max(0.0)];
    Case::new(course, value, course.noise_behind(position, scatter)).begun_at(gone)
}

/// How far the light was from setting off an event that it did set off, upwards.
fn missing(law: &PixelLaw, fired: Fired, change: f64) -> f64 {
    let theta = law.theta(fired.on);
    // A stamp that is off may be so by more than a threshold.
    let is_one = law.shot_at_white > 0.0 || (law.stamps_are_weighed && law.drop_fraction <= 0.0);
    let n = if is_one { 1.0 } else { (change / theta).round().max(1.0) };
    let towards = if fired.on { 1.0 } else { -1.0 };
    // Of all events that are memorised these were not background.
    let memorised = 1.0 - fired.background_share * (1.0 - law.background_memorised);
    let set_off = (1.0 - fired.background_share) / memorised.max(1e-12);
    towards * set_off * (theta * n - change).min(theta)
}

/// What a pixel compares with that memorised the light with noise of unknown size.
fn carried(
    course: &Course<'_>,
    fired: Fired,
    plain: Case,
    noise: &[[f64; 2]],
) -> impl Iterator<Item = Case> {
    let towards = if fired.on { 1.0 } else { -1.0 };
    let size = course.law.shot(plain.noise);
    noise.iter().map(move |[noise, weight]| Case {
        value: plain.value + towards * noise * size,
        weight: plain.weight * weight,
        ..plain
    })
}
