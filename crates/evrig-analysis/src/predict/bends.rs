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
    /// AscendingFrames, the first and the last instant of each run among them.
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
    /// instants in between: the slopes that do make a cone, which each instant narrows. The last instant within
    /// reach of a straight line becomes the next bend.
    fn add(&mut self, signal: &[f32], first: usize, last: usize) {
        self.at.push(first as u32);
        let mut from = first;
        while from < last {
            from += reach(&signal[from..=last]);
            self.at.push(from as u32);
        }
    }
}

/// How many instants ahead of the first a straight line goes; at least two are there.
fn reach(signal: &[f32]) -> usize {
    let value = signal[0];
    let next = signal[1] - value;
    let [mut low, mut high] = [next - WITHIN, next + WITHIN];
    for (i, there) in signal.iter().enumerate().skip(2) {
        let per_step = SHARES.get(i).copied().unwrap_or_else(|| (i as f32).recip());
        let slope = (there - value) * per_step;
        if !(low..=high).contains(&slope) {
            return i - 1;
        }
        let within = WITHIN * per_step;
        [low, high] = [low.max(slope - within), high.min(slope + within)];
    }
    signal.len() - 1
}

/// One over each number: a sixth of a diagnosis was spent here, half of that in divisions.
static SHARES: [f32; 64] = shares();

const fn shares() -> [f32; 64] {
    let mut shares = [f32::INFINITY; 64];
    let mut i = 1;
    while i < shares.len() {
        shares[i] = 1.0 / i as f32;
        i += 1;
    }
    shares
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
