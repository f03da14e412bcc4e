//! One pixel's log-intensity signal, sampled at a fixed step.

use super::grid::TimeGrid;

/// A signal on a time grid, interpolated between its instants.
///
/// Between instants it is the cubic through four neighbours (Catmull and Rom), whose slope is
/// continuous; next to a gap and at the ends it is linear between two.
#[derive(Debug, Clone, PartialEq)]
pub struct SignalCurve {
    grid: TimeGrid,
    values: Vec<f32>,
}

impl SignalCurve {
    /// The signal whose value at instant `i` is `values[i]`; `NaN` where it is not known. Values
    /// that are too few are unknown, those too many are left out.
    #[must_use]
    pub fn new(grid: TimeGrid, mut values: Vec<f32>) -> Self {
        values.resize(grid.n, f32::NAN);
        Self { grid, values }
    }

    /// Its instants.
    #[must_use]
    pub const fn grid(&self) -> TimeGrid {
        self.grid
    }

    /// Its values at the instants; `NaN` where not known.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The value at a time; `None` outside the grid and in a gap.
    #[must_use]
    pub fn at(&self, t_us: f64) -> Option<f64> {
        self.value_and_slope(t_us).map(|(value, _)| value)
    }

    /// The value, and its derivative per second, at a time; `None` outside the grid and in a gap.
    #[must_use]
    pub fn value_and_slope(&self, t_us: f64) -> Option<(f64, f64)> {
        let position = self.grid.position(t_us);
        let last = self.values.len().checked_sub(1)?;
        if !(0.0..=last as f64).contains(&position) {
            return None;
        }
        let i = (position.floor() as usize).min(last.saturating_sub(1));
        let u = position - i as f64;
        let known = |j: usize| self.values.get(j).copied().filter(|v| v.is_finite()).map(f64::from);
        let b = known(i)?;
        let Some(c) = known(i + 1) else { return (u == 0.0).then_some((b, 0.0)) };
        let before = i.checked_sub(1).and_then(known);
        let (m0, m1) = match (before, known(i + 2)) {
            (Some(a), Some(d)) => ((c - a) / 2.0, (d - b) / 2.0),
            _ => (c - b, c - b),
        };
        let (u2, u3) = (u * u, u * u * u);
        let value = (2.0 * u3 - 3.0 * u2 + 1.0) * b
            + (u3 - 2.0 * u2 + u) * m0
            + (-2.0 * u3 + 3.0 * u2) * c
            + (u3 - u2) * m1;
        let slope = (6.0 * u2 - 6.0 * u) * (b - c)
            + (3.0 * u2 - 4.0 * u + 1.0) * m0
            + (3.0 * u2 - 2.0 * u) * m1;
        Some((value, slope * 1e6 / f64::from(self.grid.step_us)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine() -> SignalCurve {
        let grid = TimeGrid { start_us: 1_000, step_us: 1_000, n: 200 };
        let values = (0..grid.n).map(|i| (i as f32 * 0.1).sin()).collect();
        SignalCurve::new(grid, values)
    }

    #[test]
    fn a_sine_and_its_slope_are_met_between_the_instants() {
        let curve = sine();
        for i in 10..1_900 {
            let t_us = 2_000.0 + f64::from(i) * 97.3;
            let phase = (t_us - 1_000.0) * 1e-4;
            let (value, slope) = curve.value_and_slope(t_us).unwrap();
            assert!((value - phase.sin()).abs() < 2e-4, "value at {t_us}");
            assert!((slope - 100.0 * phase.cos()).abs() < 0.3, "slope at {t_us}");
        }
    }

    #[test]
    fn outside_and_in_a_gap_nothing_is_known() {
        let mut curve = sine();
        assert_eq!(curve.at(999.0), None);
        assert_eq!(curve.at(1_000.0 + 199_001.0), None);
        curve.values[50] = f32::NAN;
        assert_eq!(curve.at(50_500.0), None);
        assert_eq!(curve.at(51_500.0), None);
        assert!(curve.at(49_900.0).is_some(), "beside the gap the line between two is taken");
        assert!(curve.at(50_000.0).is_some(), "an instant itself is known");
    }
}
