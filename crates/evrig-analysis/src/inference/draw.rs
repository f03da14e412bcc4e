//! Draws the next event of a pixel from the law, given its recorded past.

use super::pass::PixelPass;
use crate::predict::Spike;
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

impl PixelPass<'_> {
    /// Draws the next event before the end of the run, given no other.
    pub(crate) fn draw_next(&self, end_us: f64, random: &mut SplitMix) -> Option<DrawnNextEvent> {
        let mut pass = self.clone();
        let target = -(1.0 - random.uniform()).ln();
        let which = random.uniform();
        let mut passed = 0.0;
        let mut found = None;
        let end = self.signal.position(end_us).min(self.run_end());
        let from = self.position;
        pass.walk(end, |pass, middle, (all, sides)| {
            if passed + all < target {
                passed += all;
                return false;
            }
            let half = pass.position - middle;
            let share = if all > 0.0 { (target - passed) / all } else { 0.5 };
            let at = (middle - half + 2.0 * half * share).max(from);
            let on = which * (sides[0] + sides[1]) < sides[0];
            found = Some((at, on));
            true
        });
        let (at, on) = found?;
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

    fn run_end(&self) -> f64 {
        let from = self.position.max(0.0) as usize;
        let known = |i: &usize| self.signal.signal[*i].is_finite();
        let n = (from..self.signal.signal.len()).take_while(known).count();
        (from + n.max(1) - 1) as f64
    }
}
