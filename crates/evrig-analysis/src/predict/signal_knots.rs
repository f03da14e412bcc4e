//! Piecewise-linear approximation of a sampled signal.
//!
//! Between two frames, or under constant light, hundreds of samples lie on one line. The likelihood
//! needs only the samples at which the slope changes.

/// Largest deviation from the line between two knots, log intensity: a thousandth of a typical
/// threshold.
const TOLERANCE: f32 = 2e-4;

/// Runs of known samples and the knots of the linear pieces. Samples count from the signal's first.
#[derive(Debug, Clone, Default)]
pub struct SignalKnots {
    /// First and last sample of each run of at least two known samples.
    runs: Vec<[usize; 2]>,
    /// Ascending; contains the first and the last sample of each run.
    positions: Vec<u32>,
}

impl SignalKnots {
    /// The knots of a signal where it and its level are known.
    #[must_use]
    pub fn of(signal: &[f32], level: &[f32]) -> Self {
        let mut knots = Self::default();
        knots.set(signal, level);
        knots
    }

    /// Replaces the knots by those of another signal; keeps the memory.
    pub fn set(&mut self, signal: &[f32], level: &[f32]) {
        self.runs.clear();
        self.positions.clear();
        for [first, last] in known_runs(signal, level) {
            self.runs.push([first, last]);
            self.add(signal, first, last);
        }
    }

    pub(super) fn runs(&self) -> &[[usize; 2]] {
        &self.runs
    }

    pub(super) fn positions(&self) -> &[u32] {
        &self.positions
    }

    fn add(&mut self, signal: &[f32], first: usize, last: usize) {
        self.positions.push(first as u32);
        let mut from = first;
        while from < last {
            from += piece_length(&signal[from..=last]);
            self.positions.push(from as u32);
        }
    }
}

/// Number of steps for which some line from the first of at least two samples stays within the
/// tolerance. The admissible slopes form a cone, which each sample narrows.
fn piece_length(signal: &[f32]) -> usize {
    let value = signal[0];
    let next = signal[1] - value;
    let [mut low, mut high] = [next - TOLERANCE, next + TOLERANCE];
    for (i, sample) in signal.iter().enumerate().skip(2) {
        let per_step = RECIPROCALS.get(i).copied().unwrap_or_else(|| (i as f32).recip());
        let slope = (sample - value) * per_step;
        if !(low..=high).contains(&slope) {
            return i - 1;
        }
        let tolerance = TOLERANCE * per_step;
        [low, high] = [low.max(slope - tolerance), high.min(slope + tolerance)];
    }
    signal.len() - 1
}

/// Reciprocals of small numbers; divisions would dominate the run time.
static RECIPROCALS: [f32; 64] = {
    let mut reciprocals = [f32::INFINITY; 64];
    let mut i = 1;
    while i < reciprocals.len() {
        reciprocals[i] = 1.0 / i as f32;
        i += 1;
    }
    reciprocals
};

/// First and last index of each run of at least two samples at which signal and level are known.
pub(super) fn known_runs<'a>(
    signal: &'a [f32],
    level: &'a [f32],
) -> impl Iterator<Item = [usize; 2]> + use<'a> {
    let n = signal.len().min(level.len());
    let mut next = 0;
    std::iter::from_fn(move || {
        while next < n {
            let start = next;
            while next < n && signal[next].is_finite() && level[next].is_finite() {
                next += 1;
            }
            let end = next;
            next += 1;
            if end >= start + 2 {
                return Some([start, end - 1]);
            }
        }
        None
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_signal_has_knots_at_its_ends_and_corners() {
        let mut signal: Vec<f32> = (0..1000).map(|i| 0.001 * (i as f32 - 500.0).abs()).collect();
        signal[100] = f32::NAN;
        let knots = SignalKnots::of(&signal, &signal);
        assert_eq!(knots.runs(), [[0, 99], [101, 999]]);
        assert_eq!(knots.positions(), [0, 99, 101, 500, 999]);
    }

    #[test]
    fn every_sample_is_near_the_line_between_knots() {
        let at = |i: usize| (0.004 * i as f32).sin() + 0.1 * (0.02 * i as f32).cos();
        let signal: Vec<f32> = (0..5000).map(at).collect();
        let knots = SignalKnots::of(&signal, &signal);
        let mut worst = 0.0_f32;
        for pair in knots.positions().windows(2) {
            let [a, b] = [pair[0] as usize, pair[1] as usize];
            for i in a..=b {
                let share = (i - a) as f32 / (b - a) as f32;
                worst = worst.max((signal[i] - signal[a] - share * (signal[b] - signal[a])).abs());
            }
        }
        assert!(worst > 0.5 * TOLERANCE && worst < 1.01 * TOLERANCE, "{worst}");
        assert!(knots.positions().len() < 2000, "{}", knots.positions().len());
    }
}
