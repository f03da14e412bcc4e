//! The sampled log-intensity signal of a pixel.

use super::burst_window::BurstWindow;

/// A pixel's signal on a grid of instants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SampledSignal<'a> {
    /// Time of the first instant, microseconds since the window's start.
    pub(crate) start_us: f64,
    /// SelectionStep between instants, microseconds.
    pub(crate) step_us: f64,
    /// What the comparator sees, log intensity; NaN where unknown.
    pub(crate) signal: &'a [f64],
    /// Log intensity over white.
    pub(crate) level: &'a [f32],
    /// Factor of the noise at that level.
    pub(crate) darkness: &'a [f64],
    /// Bursts that follow frames, by their starts.
    pub(crate) bursts: &'a [BurstWindow],
}

impl SampledSignal<'_> {
    pub(super) fn position(&self, t_us: f64) -> f64 {
        (t_us - self.start_us) / self.step_us
    }

    pub(super) fn at(&self, position: f64) -> f64 {
        let i = (position.max(0.0) as usize).min(self.signal.len() - 2);
        let (a, b) = (self.signal[i], self.signal[i + 1]);
        a + (b - a) * (position - i as f64)
    }

    pub(super) fn slope_per_s(&self, position: f64) -> f64 {
        let i = (position.max(0.0) as usize).min(self.signal.len() - 2);
        (self.signal[i + 1] - self.signal[i]) / self.step_us * 1e6
    }

    /// First and last instant of each run of known samples.
    pub(super) fn runs(&self) -> Vec<[usize; 2]> {
        let mut runs = Vec::new();
        let mut from = None;
        for i in 0..=self.signal.len() {
            let known =
                i < self.signal.len() && self.signal[i].is_finite() && self.level[i].is_finite();
            match (known, from) {
                (true, None) => from = Some(i),
                (false, Some(first)) => {
                    if i - first >= 2 {
                        runs.push([first, i - 1]);
                    }
                    from = None;
                }
                _ => {}
            }
        }
        runs
    }
}
