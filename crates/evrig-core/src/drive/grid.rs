//! Equidistant instants.

/// Instants at a fixed step, microseconds of the events' clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeGrid {
    /// The first instant.
    pub start_us: i64,
    /// Interval between instants; at least 1.
    pub step_us: u32,
    /// Number of instants.
    pub n: usize,
}

impl TimeGrid {
    /// The grid of the given step that covers `[first, last]`: it begins at `first`, and its last
    /// instant is at or just after `last`.
    #[must_use]
    pub fn covering([first, last]: [i64; 2], step_us: u32) -> Self {
        let step_us = step_us.max(1);
        let n = (last - first).max(0).unsigned_abs().div_ceil(u64::from(step_us)) as usize + 1;
        Self { start_us: first, step_us, n }
    }

    /// The instant number `index`.
    #[must_use]
    pub const fn at(&self, index: usize) -> i64 {
        self.start_us + index as i64 * self.step_us as i64
    }

    /// Position of `t_us` on the grid, in steps from its start; integral at an instant.
    #[must_use]
    pub fn position(&self, t_us: f64) -> f64 {
        (t_us - self.start_us as f64) / f64::from(self.step_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_covers_its_range_and_no_more_than_a_step_beyond() {
        let grid = TimeGrid::covering([10, 1_009], 500);
        assert_eq!((grid.n, grid.at(0), grid.at(grid.n - 1)), (3, 10, 1_010));
        assert_eq!(TimeGrid::covering([5, 5], 0), TimeGrid { start_us: 5, step_us: 1, n: 1 });
    }

    #[test]
    fn a_position_counts_steps() {
        let grid = TimeGrid { start_us: 100, step_us: 50, n: 9 };
        assert!((grid.position(175.0) - 1.5).abs() < 1e-12);
    }
}
