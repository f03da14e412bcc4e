//! Draws the next event of a pixel from the law, given its recorded past.

use super::pass::PixelPass;
use super::pixel_events::Spike;
use evrig_core::stats::SplitMix;

/// An event drawn from the law.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrawnNextEvent {
    /// The event.
    pub(crate) spike: Spike,
    /// Change since the reference level, thresholds.
    pub(crate) change: f64,
    /// LikelihoodSlope towards the polarity, log intensity per second.
    pub(crate) slope_per_s: f64,
    /// Log intensity over white.
    pub(crate) level: f64,
}

/// Halvings of a segment between instants: to a microsecond in a millisecond.
const N_BISECTIONS: usize = 10;

impl PixelPass<'_> {
    /// Draws the next event before the end of the run, given no other.
    pub(crate) fn draw_next(&self, end_us: f64, random: &mut SplitMix) -> Option<DrawnNextEvent> {
        let mut pass = self.clone();
        let target = -(1.0 - random.uniform()).ln();
        let which = random.uniform();
        let end = self.signal.position(end_us).min(self.run_end());
        let mut before = self.clone();
        let mut passed = 0.0;
        let mut is_found = false;
        pass.walk(end, |pass, _, (all, _)| {
            is_found = passed + all >= target;
            if !is_found {
                passed += all;
                before = pass.clone();
            }
            is_found
        });
        if !is_found {
            return None;
        }
        let (at, sides) = before.bisected(pass.position, target - passed);
        let on = which * (sides[0] + sides[1]) < sides[0];
        pass.position = at;
        let side = usize::from(!on);
        let sign = if on { 1.0 } else { -1.0 };
        let weight: f64 = pass.states.iter().map(|s| s.weight).sum();
        let reference: f64 =
            pass.states.iter().map(|s| s.weight * s.reference).sum::<f64>() / weight;
        Some(DrawnNextEvent {
            spike: Spike { t_us: (self.signal.start_us + at * self.signal.step_us) as i64, on },
            change: sign * (pass.leaky(at) - reference) / self.law.theta[side],
            slope_per_s: sign * self.signal.slope_per_s(at),
            level: f64::from(self.signal.level[(at as usize).min(self.signal.level.len() - 1)]),
        })
    }

    /// Position up to `to` at which the compensator reaches a target, and the compensators of the
    /// two polarities around it. A hazard can rise within a small part of a segment.
    fn bisected(&self, to: f64, target: f64) -> (f64, [f64; 2]) {
        let mut left = self.clone();
        let (mut right, mut passed, mut sides) = (to, 0.0, [0.5; 2]);
        for _ in 0..N_BISECTIONS {
            let mut middle = left.clone();
            let mut there = (0.0, [0.0; 2]);
            middle.walk(0.5 * (left.position + right), |_, _, (all, sides)| {
                there = (there.0 + all, [there.1[0] + sides[0], there.1[1] + sides[1]]);
                false
            });
            if there.0 > 0.0 {
                sides = there.1;
            }
            if passed + there.0 < target {
                passed += there.0;
                left = middle;
            } else {
                right = middle.position;
            }
        }
        (0.5 * (left.position + right), sides)
    }

    fn run_end(&self) -> f64 {
        let from = self.position.max(0.0) as usize;
        let known = |i: &usize| self.signal.signal[*i].is_finite();
        let n = (from..self.signal.signal.len()).take_while(known).count();
        (from + n.max(1) - 1) as f64
    }
}
