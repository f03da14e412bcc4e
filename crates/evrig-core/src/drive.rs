//! The drive: the log-intensity signal of each event pixel, as a function of time.
//!
//! It comes from a map of the target and the camera's path over it, or from frames between which
//! it is interpolated. Generators, prediction and diagnosis read it through [`Drive`], one pixel at
//! a time.

mod curve;
mod grid;

pub use curve::SignalCurve;
pub use grid::TimeGrid;

use crate::geometry::Size;

/// The log-intensity signal of a session's event pixels.
pub trait Drive: Send + Sync {
    /// Columns and rows of the event camera.
    fn size(&self) -> Size;

    /// First and last instant at which there is a signal, microseconds of the events' clock.
    fn span_us(&self) -> [i64; 2];

    /// The frames' value on the target's white, above the black level, in their own digital
    /// units: the intensity `exp(0)` of the drive. Generators whose constants are stated
    /// in such units take `white_dn * exp(drive)`.
    fn white_dn(&self) -> f64;

    /// Writes the natural logarithm of intensity over white at `place` for every instant of `grid`
    /// into `out`, which has `grid.n` values; `NaN` where it is unknown. Returns
    /// whether any instant is known.
    ///
    /// `place` is continuous: pixel (x, y) covers `x..x + 1`, its centre is at `x + 0.5`. The
    /// aperture of a pixel is part of the signal; positions inside a pixel differ by the gradient.
    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool;

    /// Standard error of the signal's change over a fraction of a second at `place`, in units of
    /// the signal; `NaN` where it is unknown.
    fn error(&self, place: [f64; 2]) -> f32;

    /// Standard deviation of the signal's noise at `place` from one sample to the next, in units of
    /// the signal; zero where the signal is not made of single samples.
    fn noise(&self, _place: [f64; 2]) -> f32 {
        0.0
    }

    /// Intervals in which the global illumination changed abruptly between two samples (a flash, a
    /// switched lamp), ascending and disjoint, microseconds of the events' clock. [`Drive::sample`]
    /// interpolates across them, but time and speed of the change are unknown: analyses of single
    /// events exclude them.
    fn jumps_us(&self) -> Vec<[i64; 2]> {
        Vec::new()
    }

    /// The signal of a pixel on a grid; `None` where it is unknown.
    fn curve(&self, x: u16, y: u16, grid: TimeGrid) -> Option<SignalCurve> {
        let mut values = vec![f32::NAN; grid.n];
        let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        self.sample(place, grid, &mut values).then(|| SignalCurve::new(grid, values))
    }
}
