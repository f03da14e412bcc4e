//! The light as a fitted hypothesis has the event camera see it: its clock, its place, its blur.

use super::placing::Placing;
use super::{Evidence, Hypothesis, Nuisance};
use crate::drive::{Drive, TimeGrid};
use crate::geometry::Size;

/// A drive with a hypothesis's nuisances in it, on the events' clock.
pub(super) struct Tuned<'a> {
    drive: &'a dyn Drive,
    placing: Placing,
    middle: [f64; 2],
    half_blur: f32,
    /// What is added to an event's time to find the light's, and more a microsecond since `at_us`.
    late_us: f64,
    skew: f64,
    at_us: f64,
}

impl<'a> Tuned<'a> {
    pub(super) fn new(drive: &'a dyn Drive, evidence: &Evidence, hypothesis: &Hypothesis) -> Self {
        let value = |nuisance| hypothesis.nuisance(nuisance);
        let tied = evidence.facts.clocks;
        let middle = evidence.start_us + 0.5e6 * evidence.seconds();
        Self {
            drive,
            placing: Placing::of(&hypothesis.values),
            middle: evidence.middle,
            half_blur: 0.5 * value(Nuisance::BlurPx2) as f32,
            late_us: tied.map_or(0.0, |t| t.offset_us[0]) - value(Nuisance::OffsetUs),
            skew: tied.map_or(0.0, |t| t.skew_ppm[0] * 1e-6),
            at_us: evidence.window_us[0] as f64 + middle,
        }
    }

    /// The light's time at an event's.
    fn light_us(&self, t_us: f64) -> f64 {
        t_us + self.late_us + self.skew * (t_us - self.at_us)
    }

    /// The light on its own clock, its blur in it.
    fn blurred(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        let is_known = self.drive.sample(place, grid, out);
        if self.half_blur == 0.0 || !is_known {
            return is_known;
        }
        let mut bend = vec![-4.0; grid.n];
        let mut side = vec![f32::NAN; grid.n];
        for [dx, dy] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            self.drive.sample([place[0] + dx, place[1] + dy], grid, &mut side);
            for ((bend, side), here) in bend.iter_mut().zip(&side).zip(&*out) {
                *bend += (side - here).exp();
            }
        }
        for (value, bend) in out.iter_mut().zip(bend) {
            *value += (self.half_blur * bend).clamp(-0.7, 0.7);
        }
        true
    }
}

impl Drive for Tuned<'_> {
    fn size(&self) -> Size {
        self.drive.size()
    }

    fn span_us(&self) -> [i64; 2] {
        self.drive.span_us()
    }

    fn white_dn(&self) -> f64 {
        self.drive.white_dn()
    }

    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        let place = self.placing.seen_at(place, self.middle);
        let [first, last] =
            [grid.at(0), grid.at(grid.n.saturating_sub(1))].map(|t| self.light_us(t as f64));
        let own = TimeGrid::covering([first.floor() as i64, last.ceil() as i64], grid.step_us);
        let mut values = vec![f32::NAN; own.n];
        if !self.blurred(place, own, &mut values) {
            return false;
        }
        let mut is_known = false;
        for (i, out) in out.iter_mut().enumerate() {
            let position = own.position(self.light_us(grid.at(i) as f64)).max(0.0);
            let left = (position as usize).min(own.n.saturating_sub(2));
            let (a, b) = (values[left], values.get(left + 1).copied().unwrap_or(f32::NAN));
            *out = a + (b - a) * (position - left as f64) as f32;
            is_known |= out.is_finite();
        }
        is_known
    }

    fn error(&self, place: [f64; 2]) -> f32 {
        self.drive.error(place)
    }
}
