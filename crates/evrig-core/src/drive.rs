//! The drive: the logarithm of the light that an event pixel sees, at any time.
//!
//! It is what event pixels are driven by, whether it comes from a map of the print and the
//! path of the camera over it or from frames between which it is interpolated. Whoever makes,
//! predicts or explains events takes it through [`Drive`], a pixel at a time.

mod curve;
mod grid;

pub use curve::SignalCurve;
pub use grid::TimeGrid;

use crate::geometry::Size;

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
    fn curve(&self, x: u16, y: u16, grid: TimeGrid) -> Option<SignalCurve> {
        let mut values = vec![f32::NAN; grid.n];
        let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        self.sample(place, grid, &mut values).then(|| SignalCurve::new(grid, values))
    }
}
