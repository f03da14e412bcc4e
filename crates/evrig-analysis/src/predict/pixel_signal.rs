//! The log-intensity signal of a pixel on a time grid.

use super::signal_knots::{SignalKnots, known_runs};

/// One pixel's signal, linear between samples.
#[derive(Debug, Clone, Copy)]
pub struct PixelSignal<'a> {
    /// Time of the first sample, microseconds since the start of the events' window.
    pub start_us: f64,
    /// Sampling interval, microseconds; above 0.
    pub step_us: f64,
    /// What the comparators see: filtered log intensity; `NaN` where unknown.
    pub signal: &'a [f32],
    /// Log intensity relative to white, which sets the noise; as long as `signal`.
    pub level: &'a [f32],
    /// Knots of the signal's piecewise-linear approximation; without, every sample is evaluated.
    pub knots: Option<&'a SignalKnots>,
}

impl<'a> PixelSignal<'a> {
    /// Runs of known samples inside the window up to `end_us`: first and last sample, and begin and
    /// end in microseconds since the window's start.
    pub(super) fn known_intervals(
        self,
        end_us: i64,
    ) -> impl Iterator<Item = ([usize; 2], [f64; 2])> + use<'a> {
        let at = move |index: usize| self.start_us + index as f64 * self.step_us;
        let cut = move |run: [usize; 2]| [at(run[0]).max(0.0), at(run[1]).min(end_us as f64)];
        let computed = self.knots.is_none().then(|| known_runs(self.signal, self.level));
        let stored = self.knots.map(|knots| knots.runs().iter().copied());
        let runs = computed.into_iter().flatten().chain(stored.into_iter().flatten());
        runs.map(move |run| (run, cut(run))).filter(|(_, [from, to])| from < to)
    }

    /// Rate of change at a position on a run, per second.
    pub(super) fn slope(&self, position: f64, [first, last]: [usize; 2]) -> f64 {
        let i = (position.max(0.0) as usize).clamp(first, last - 1);
        (f64::from(self.signal[i + 1]) - f64::from(self.signal[i])) / self.step_us * 1e6
    }

    /// Signal at a position (in samples) on a run.
    pub(super) fn at(&self, position: f64, [first, last]: [usize; 2]) -> f64 {
        let i = (position.max(0.0) as usize).clamp(first, last - 1);
        let (a, b) = (f64::from(self.signal[i]), f64::from(self.signal[i + 1]));
        a + (b - a) * (position - i as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_split_the_signal_into_runs_of_at_least_two_samples() {
        let n = f32::NAN;
        let values = [n, 1.0, 2.0, n, 3.0, n, n, 4.0, 5.0, 6.0];
        let light = PixelSignal {
            start_us: 0.0,
            step_us: 1.0,
            signal: &values,
            level: &values,
            knots: None,
        };
        assert_eq!(known_runs(&values, &values).collect::<Vec<_>>(), [[1, 2], [7, 9]]);
        assert!((light.at(7.5, [7, 9]) - 4.5).abs() < 1e-12);
        assert!((light.at(9.0, [7, 9]) - 6.0).abs() < 1e-12);
    }
}
