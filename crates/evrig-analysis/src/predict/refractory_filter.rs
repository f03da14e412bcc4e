//! A dead time behind the pixel: a filter takes out events too soon after one that it let through,
//! while the pixel goes on firing and memorising.

use super::course::Course;
use super::memory::Case;

/// More unseen events than these blur what the pixel compares with no further.
const MOST_BLUR: u32 = 6;

/// How a pixel stands: what it compares with, how far the signal has gone from there.
#[derive(Debug, Clone, Copy)]
struct Standing {
    value: f64,
    gone: [f64; 2],
}

impl Standing {
    fn follow(&mut self, height: f64) {
        let change = height - self.value;
        self.gone = [self.gone[0].max(change), self.gone[1].max(-change)];
    }

    /// Behind an event of one side, On or Off, the signal being at `height`.
    fn behind(self, side: usize, theta: [f64; 2], height: f64) -> Self {
        let by = if side == 0 { theta[0] } else { -theta[1] };
        let mut next = Self { value: self.value + by, gone: [0.0; 2] };
        next.follow(height);
        next
    }
}

/// The ways in which a pixel may stand at `to` that stood as `case` at `from`, events in between
/// not being seen. It fires at its thresholds; whether the last of these firings has come yet, and
/// whether one more has, the scatter of the thresholds leaves open. They are put behind `cases`.
pub(super) fn behind_mask(
    course: &Course<'_>,
    case: &Case,
    [from, to]: [f64; 2],
    cases: &mut Vec<Case>,
) {
    let theta = [course.law.theta_on, course.law.theta_off];
    let mut now = Standing { value: case.value, gone: case.gone };
    let (mut before, mut n) = (None::<Standing>, 0_u32);
    let end = course.height(to);
    for height in course.instants(from, to).map(|(_, height)| height).chain([end]) {
        if let Some(before) = &mut before {
            before.follow(height);
        }
        now.follow(height);
        while let Some(side) = (0..2).find(|&side| now.gone[side] >= theta[side]) {
            before = Some(now);
            now = now.behind(side, theta, height);
            n += 1;
        }
    }
    let blurred = |n: u32| {
        let noise = course.noise(to) * f64::from(1 + n.min(MOST_BLUR)).sqrt();
        Case::new(course, 0.0, noise)
    };
    let at = |standing: Standing, n: u32, weight: f64| Case {
        weight: case.weight * weight,
        value: standing.value,
        ..blurred(n).begun_at(standing.gone)
    };
    let silent = |standing: Standing, n: u32| {
        let case = at(standing, n, 1.0);
        (-case.spent_before(0) - case.spent_before(1)).exp()
    };
    let not_yet = before.map_or(0.0, |before| silent(before, n.saturating_sub(1)));
    let no_more = silent(now, n);
    cases.push(at(now, n, (1.0 - not_yet) * no_more));
    cases.extend(before.map(|before| at(before, n.saturating_sub(1), not_yet)));
    let side = usize::from(now.gone[1] / theta[1] > now.gone[0] / theta[0]);
    let more = now.behind(side, theta, end);
    cases.push(at(more, n + 1, (1.0 - not_yet) * (1.0 - no_more)));
}
