//! A signal's course in straight pieces.
//!
//! Between two frames, or while nothing moves, hundreds of instants lie on one line. A pass over a
//! pixel needs only the instants at which the line bends.

use super::Light;

/// How far a signal may leave the straight line between two bends, log intensity: a thousandth of an
/// ordinary threshold.
const WITHIN: f32 = 2e-4;

/// Where a pixel's signal is known and where it bends. Instants count from the light's first.
#[derive(Debug, Clone, Default)]
pub struct Bends {
    /// Stretches of at least two instants at which the light is known, first and last.
    runs: Vec<[usize; 2]>,
    /// Ascending, the first and the last instant of each run among them.
    at: Vec<u32>,
}

impl Bends {
    /// Of a light.
    #[must_use]
    pub fn of(light: Light<'_>) -> Self {
        let mut bends = Self::default();
        bends.set(light);
        bends
    }

    /// The same in memory that was used before.
    pub fn set(&mut self, light: Light<'_>) {
        self.runs.clear();
        self.at.clear();
        let known = Light { bends: None, ..light }.known();
        for [first, last] in known {
            self.runs.push([first, last]);
            self.add(light.signal, first, last);
        }
    }

    /// The runs.
    pub(super) fn runs(&self) -> &[[usize; 2]] {
        &self.runs
    }

    /// The instants at which the signal bends.
    pub(super) fn at(&self) -> &[u32] {
        &self.at
    }

    /// From each bend, the next is as far ahead as some straight line from here stays near all
    /// instants in between: the slopes that do make a cone, which each instant narrows.
    fn add(&mut self, signal: &[f32], first: usize, last: usize) {
        self.at.push(first as u32);
        let (mut from, mut value) = (first, signal[first]);
        let mut cone = [f32::NEG_INFINITY, f32::INFINITY];
        for i in first + 1..=last {
            let mut per_step = ((i - from) as f32).recip();
            let mut slope = (signal[i] - value) * per_step;
            if !(cone[0]..=cone[1]).contains(&slope) {
                // The instant before was within reach of a straight line: it becomes the bend.
                (from, value) = (i - 1, signal[i - 1]);
                self.at.push(from as u32);
                cone = [f32::NEG_INFINITY, f32::INFINITY];
                (per_step, slope) = (1.0, signal[i] - value);
            }
            let within = WITHIN * per_step;
            cone = [cone[0].max(slope - within), cone[1].min(slope + within)];
        }
        self.at.push(last as u32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(signal: &[f32]) -> Light<'_> {
        Light { start_us: 0.0, step_us: 1.0, signal, level: signal, bends: None }
    }

    #[test]
    fn a_straight_signal_bends_at_its_ends_and_a_corner_in_between() {
        let mut signal: Vec<f32> = (0..1000).map(|i| 0.001 * (i as f32 - 500.0).abs()).collect();
        signal[100] = f32::NAN;
        let bends = Bends::of(light(&signal));
        assert_eq!(bends.runs(), [[0, 99], [101, 999]]);
        assert_eq!(bends.at(), [0, 99, 101, 500, 999]);
    }

    #[test]
    fn no_instant_is_far_from_the_line_between_bends() {
        let at = |i: usize| (0.004 * i as f32).sin() + 0.1 * (0.02 * i as f32).cos();
        let signal: Vec<f32> = (0..5000).map(at).collect();
        let bends = Bends::of(light(&signal));
        let mut worst = 0.0_f32;
        for pair in bends.at().windows(2) {
            let [a, b] = [pair[0] as usize, pair[1] as usize];
            for i in a..=b {
                let share = (i - a) as f32 / (b - a) as f32;
                worst = worst.max((signal[i] - signal[a] - share * (signal[b] - signal[a])).abs());
            }
        }
        assert!(worst > 0.5 * WITHIN && worst < 1.01 * WITHIN, "{worst}");
        assert!(bends.at().len() < 2000, "{}", bends.at().len());
    }
}
