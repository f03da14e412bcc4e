//! The law of the voltages of a block of pixels.

use std::ops::Range;

/// The law of each pixel's voltage: normal with this mean and variance.
#[derive(Debug)]
pub(crate) struct Voltages {
    pub(super) mean: Vec<f32>,
    /// What rounding added to the mean: many small moves add up without drift (Kahan).
    pub(super) excess: Vec<f32>,
    /// Grows from 0 after each draw; f32 keeps it to n frames times 6e-8.
    pub(super) variance: Vec<f32>,
}

/// The columns of some pixels' state.
pub(super) struct VoltageColumns<'a> {
    pub(super) mean: &'a mut [f32],
    pub(super) excess: &'a mut [f32],
    pub(super) variance: &'a mut [f32],
}

/// A voltage of which so much is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct VoltageMoments {
    pub(crate) mean: f64,
    pub(crate) variance: f64,
}

impl Voltages {
    pub(super) fn moments(&self, i: usize) -> VoltageMoments {
        let mean = f64::from(self.mean[i]) - f64::from(self.excess[i]);
        VoltageMoments { mean, variance: f64::from(self.variance[i]) }
    }

    pub(super) fn columns(&mut self, pixels: Range<usize>) -> VoltageColumns<'_> {
        VoltageColumns {
            mean: &mut self.mean[pixels.clone()],
            excess: &mut self.excess[pixels.clone()],
            variance: &mut self.variance[pixels],
        }
    }

    pub(super) fn set(&mut self, i: usize, moments: VoltageMoments) {
        self.mean[i] = moments.mean as f32;
        self.excess[i] = (f64::from(self.mean[i]) - moments.mean) as f32;
        self.variance[i] = moments.variance as f32;
    }

    #[cfg(test)]
    pub(crate) fn all_moments(&self) -> Vec<VoltageMoments> {
        (0..self.mean.len()).map(|i| self.moments(i)).collect()
    }
}
