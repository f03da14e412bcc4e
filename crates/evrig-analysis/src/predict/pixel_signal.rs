//! The light of pixels on a time grid, as the predictor takes it.

use super::Bends;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::geometry::Size;
use rayon::prelude::*;

/// One pixel's light. Between two instants the signal is straight.
#[derive(Debug, Clone, Copy)]
pub struct Light<'a> {
    /// Time of the first instant, microseconds since the start of the events' window.
    pub start_us: f64,
    /// From one instant to the next, microseconds; above 0.
    pub step_us: f64,
    /// What the pixel compares: log intensity after whatever filters it; `NaN` where not known.
    pub signal: &'a [f32],
    /// Log intensity over white, which sets the noise; as long as `signal`.
    pub level: &'a [f32],
    /// Where the signal bends, which makes passes over it faster; none to look at every instant.
    pub bends: Option<&'a Bends>,
}

impl<'a> Light<'a> {
    /// Stretches of known light inside the window up to `end_us`, with their begin and end,
    /// microseconds since the window's start.
    pub(super) fn stretches(
        self,
        end_us: i64,
    ) -> impl Iterator<Item = ([usize; 2], [f64; 2])> + use<'a> {
        let at = move |index: usize| self.start_us + index as f64 * self.step_us;
        let cut = move |run: [usize; 2]| [at(run[0]).max(0.0), at(run[1]).min(end_us as f64)];
        self.known().map(move |run| (run, cut(run))).filter(|(_, [from, to])| from < to)
    }

    /// Stretches of at least two instants at which the signal is known, first and last index.
    pub(super) fn known(self) -> impl Iterator<Item = [usize; 2]> + use<'a> {
        let n = self.signal.len().min(self.level.len());
        let mut next = 0;
        std::iter::from_fn(move || {
            if let Some(bends) = self.bends {
                next += 1;
                return bends.runs().get(next - 1).copied();
            }
            while next < n {
                let start = next;
                while next < n && self.signal[next].is_finite() && self.level[next].is_finite() {
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

    /// Rate of change of the signal at a position, a second.
    pub(super) fn slope(&self, position: f64, [first, last]: [usize; 2]) -> f64 {
        let i = (position.max(0.0) as usize).clamp(first, last - 1);
        (f64::from(self.signal[i + 1]) - f64::from(self.signal[i])) / self.step_us * 1e6
    }

    /// Signal at a position in steps from the start, on a known stretch.
    pub(super) fn at(&self, position: f64, [first, last]: [usize; 2]) -> f64 {
        let i = (position.max(0.0) as usize).clamp(first, last - 1);
        let (a, b) = (f64::from(self.signal[i]), f64::from(self.signal[i + 1]));
        a + (b - a) * (position - i as f64)
    }
}

/// The log intensity of some pixels, held in memory.
#[derive(Debug, Clone)]
pub struct Lights {
    size: Size,
    grid: TimeGrid,
    /// Start of the grid against the start of the events' window, microseconds.
    start_us: f64,
    pixels: Vec<(u16, u16)>,
    values: Vec<f32>,
}

impl Lights {
    /// Samples the drive for those of `pixels` of which anything is known. Time counts from
    /// `window_us[0]`; instants go from the drive's begin or the window's to the end of either.
    #[must_use]
    pub fn new(
        drive: &dyn Drive,
        pixels: &[(u16, u16)],
        window_us: [i64; 2],
        step_us: u32,
    ) -> Self {
        let [first, last] = drive.span_us();
        let span = [first.max(window_us[0]), last.min(window_us[1])];
        let mut grid = TimeGrid::covering(span, step_us);
        if span[1] <= span[0] {
            grid.n = 0;
        }
        let sampled: Vec<Option<Vec<f32>>> = pixels
            .par_iter()
            .map(|&(x, y)| {
                let mut values = vec![f32::NAN; grid.n];
                let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                drive.sample(place, grid, &mut values).then_some(values)
            })
            .collect();
        let mut kept = Vec::new();
        let mut all = Vec::new();
        for (&pixel, values) in pixels.iter().zip(sampled) {
            if let Some(values) = values {
                kept.push(pixel);
                all.extend_from_slice(&values);
            }
        }
        let start_us = (grid.start_us - window_us[0]) as f64;
        Self { size: drive.size(), grid, start_us, pixels: kept, values: all }
    }

    /// The pixel grid.
    #[must_use]
    pub const fn size(&self) -> Size {
        self.size
    }

    /// The instants, of the events' clock.
    #[must_use]
    pub const fn grid(&self) -> TimeGrid {
        self.grid
    }

    /// Time of the first instant, microseconds since the start of the events' window.
    #[must_use]
    pub const fn start_us(&self) -> f64 {
        self.start_us
    }

    /// The pixels, in the order in which they were asked for.
    #[must_use]
    pub fn pixels(&self) -> &[(u16, u16)] {
        &self.pixels
    }

    /// Log intensity of pixel number `index` of [`Self::pixels`] at every instant.
    #[must_use]
    pub fn values(&self, index: usize) -> &[f32] {
        &self.values[index * self.grid.n..(index + 1) * self.grid.n]
    }

    /// Light of pixel number `index` as it is, nothing filtered.
    #[must_use]
    pub fn light(&self, index: usize) -> Light<'_> {
        let values = self.values(index);
        let step_us = f64::from(self.grid.step_us);
        Light { start_us: self.start_us, step_us, signal: values, level: values, bends: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_part_the_light_into_stretches_of_at_least_two_instants() {
        let n = f32::NAN;
        let values = [n, 1.0, 2.0, n, 3.0, n, n, 4.0, 5.0, 6.0];
        let light =
            Light { start_us: 0.0, step_us: 1.0, signal: &values, level: &values, bends: None };
        assert_eq!(light.known().collect::<Vec<_>>(), [[1, 2], [7, 9]]);
        assert!((light.at(7.5, [7, 9]) - 4.5).abs() < 1e-12);
        assert!((light.at(9.0, [7, 9]) - 6.0).abs() < 1e-12);
    }
}
