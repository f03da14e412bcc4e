//! The drive: the logarithm of the light that an event pixel sees, at any time.
//!
//! It is what event pixels are driven by, whether it comes from a map of the print and the
//! path of the camera over it or from frames between which it is interpolated. Whoever makes,
//! predicts or explains events takes it through [`Drive`], a pixel at a time.

mod curve;

pub use curve::Curve;

use crate::geometry::Size;

/// Instants at a fixed step, microseconds of the events' clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeGrid {
    /// The first instant.
    pub start_us: i64,
    /// From one instant to the next; at least 1.
    pub step_us: u32,
    /// Number of instants.
    pub n: usize,
}

impl TimeGrid {
    /// The grid of the given step that covers `[first, last]`: it begins at `first`, and its last
    /// instant is at or just behind `last`.
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

    /// Where `t_us` lies on the grid, in steps from its start; whole at an instant.
    #[must_use]
    pub fn position(&self, t_us: f64) -> f64 {
        (t_us - self.start_us as f64) / f64::from(self.step_us)
    }
}

/// The light signal of a session's event pixels.
pub trait Drive: Send + Sync {
    /// Columns and rows of the event camera.
    fn size(&self) -> Size;

    /// First and last instant at which there is a signal, microseconds of the events' clock.
    fn span_us(&self) -> [i64; 2];

    /// What the frames read on the print's brightest paper, above the black level, in their own
    /// digital units: the intensity `exp(0)` of the drive. Generators whose constants are stated
    /// in such units take `white_dn * exp(drive)`.
    fn white_dn(&self) -> f64;

    /// Writes the natural logarithm of intensity over white at `place` for every instant of `grid`
    /// into `out`, which has `grid.n` values; `NaN` where nothing is known of the light. Returns
    /// whether any instant is known.
    ///
    /// `place` is continuous: pixel (x, y) covers `x..x + 1`, its middle is at `x + 0.5`. The
    /// aperture of a pixel is part of the signal; neighbouring places differ by the gradient.
    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool;

    /// Standard error of the signal's change over a fraction of a second at `place`, in units of
    /// the signal; `NaN` where it is not known.
    fn error(&self, place: [f64; 2]) -> f32;

    /// Standard deviation by which the signal at `place` goes up and down from one look at it to the next
    /// though nothing has changed, in units of the signal; zero where it comes of no single looks.
    fn noise(&self, _place: [f64; 2]) -> f32 {
        0.0
    }

    /// Stretches in which the light of everything jumped between two looks at it (a flash, a lamp that
    /// was switched), ascending and apart, microseconds of the events' clock. [`Drive::sample`] leads
    /// across them, but when and how fast the jump came is not known: who judges single events leaves
    /// them out.
    fn jumps_us(&self) -> Vec<[i64; 2]> {
        Vec::new()
    }

    /// The signal of a pixel on a grid; `None` where nothing is known of it.
    fn curve(&self, x: u16, y: u16, grid: TimeGrid) -> Option<Curve> {
        let mut values = vec![f32::NAN; grid.n];
        let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        self.sample(place, grid, &mut values).then(|| Curve::new(grid, values))
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
