//! Power of evenly spaced samples by frequency, under Hann's window, which keeps slow changes out of
//! high frequencies.

use realfft::num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use std::f64::consts::TAU;
use std::sync::Arc;

/// The transform of a number of samples, with its window and memory.
pub(super) struct HannSpectrum {
    transform: Arc<dyn RealToComplex<f64>>,
    window: Vec<f64>,
    windowed: Vec<f64>,
    amplitudes: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

impl HannSpectrum {
    /// `n` samples, at least two.
    pub(super) fn new(n: usize) -> Self {
        let transform = RealFftPlanner::new().plan_fft_forward(n);
        let window = (0..n).map(|i| 0.5 * (1.0 - (TAU * i as f64 / n as f64).cos())).collect();
        Self {
            window,
            windowed: transform.make_input_vec(),
            amplitudes: transform.make_output_vec(),
            scratch: transform.make_scratch_vec(),
            transform,
        }
    }

    /// Adds `scale` times the power of the samples about their mean to `power`, from the lowest
    /// frequency on.
    pub(super) fn add_power(&mut self, samples: &[f64], scale: f64, power: &mut [f64]) {
        let Self { transform, window, windowed, amplitudes, scratch } = self;
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        let about_mean = samples.iter().zip(&*window);
        for (windowed, (value, weight)) in windowed.iter_mut().zip(about_mean) {
            *windowed = (value - mean) * weight;
        }
        // Fails only where lengths differ, which `new` excludes.
        if transform.process_with_scratch(windowed, amplitudes, scratch).is_ok() {
            for (power, amplitude) in power.iter_mut().zip(&*amplitudes) {
                *power += scale * amplitude.norm_sqr();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_its_power_at_its_own_frequency() {
        let n = 64;
        let sine: Vec<f64> = (0..n).map(|i| (TAU * 5.0 * i as f64 / n as f64).sin()).collect();
        let mut power = vec![0.0; n / 2];
        HannSpectrum::new(n).add_power(&sine, 1.0, &mut power);
        for (k, power) in power.iter().enumerate() {
            // A sine of amplitude one under Hann's window has a quarter of the samples as its
            // amplitude, and half of that beside it.
            let expected = match k {
                5 => 16.0_f64.powi(2),
                4 | 6 => 8.0_f64.powi(2),
                _ => 0.0,
            };
            assert!((power - expected).abs() < 1e-9, "{k}: {power}");
        }
    }
}
