//! Power of a rate by frequency, and the power of noise there.

use super::hann_spectrum::HannSpectrum;
use evrig_core::stats::upper_median;
use statrs::function::gamma::gamma_ur;

/// Frequencies to either side, beyond the line itself, whose median power is the noise's.
const SURROUNDING_BINS: usize = 40;
pub(super) const LINE_BINS: usize = 3;

/// Mean power by frequency.
pub(super) struct RateSpectrum {
    pub(super) power: Vec<f64>,
    /// Noise's power, from the surroundings.
    pub(super) noise: Vec<f64>,
    pub(super) n_stretches: f64,
}

impl RateSpectrum {
    /// Mean power over stretches of equal length, a power of two.
    pub(super) fn of(stretches: &[&[f64]]) -> Self {
        let n_samples = stretches.first().map_or(2, |stretch| stretch.len());
        let n_stretches = stretches.len().max(1) as f64;
        let mut power = vec![0.0; n_samples / 2];
        let mut spectrum = HannSpectrum::new(n_samples);
        stretches.iter().for_each(|s| spectrum.add_power(s, n_stretches.recip(), &mut power));
        let noise = surroundings(&power, n_stretches);
        Self { power, noise, n_stretches }
    }

    pub(super) fn ratio(&self, bin: usize) -> f64 {
        match (self.power.get(bin), self.noise.get(bin)) {
            (Some(power), Some(noise)) if *noise > 0.0 => power / noise,
            _ => 0.0,
        }
    }

    /// Probability that noise has the power of a bin or more.
    pub(super) fn chance(&self, bin: usize) -> f64 {
        let ratio = self.ratio(bin);
        if ratio <= 1.0 { 1.0 } else { gamma_ur(self.n_stretches, self.n_stretches * ratio) }
    }

    /// The ratio to noise that noise exceeds with a probability.
    pub(super) fn ratio_at(&self, chance: f64) -> f64 {
        let (mut low, mut high) = (1.0, 1e3);
        for _ in 0..60 {
            let middle: f64 = 0.5 * (low + high);
            let is_below = gamma_ur(self.n_stretches, self.n_stretches * middle) > chance;
            (low, high) = if is_below { (middle, high) } else { (low, middle) };
        }
        high
    }

    pub(super) fn is_peak(&self, bin: usize) -> bool {
        let from = bin.saturating_sub(LINE_BINS);
        let near = &self.power[from..(bin + LINE_BINS + 1).min(self.power.len())];
        near.iter().all(|power| *power <= self.power[bin])
    }
}

/// Mean power of noise at each frequency: the median of the surroundings over the median of a
/// gamma variable with mean one (Wilson and Hilferty).
fn surroundings(power: &[f64], n_stretches: f64) -> Vec<f64> {
    let median = (1.0 - 1.0 / (9.0 * n_stretches)).powi(3);
    let median = if n_stretches < 1.5 { std::f64::consts::LN_2 } else { median };
    let mut near = Vec::with_capacity(2 * SURROUNDING_BINS);
    (0..power.len())
        .map(|bin| {
            near.clear();
            let from = bin.saturating_sub(SURROUNDING_BINS).max(1);
            let to = (bin + SURROUNDING_BINS + 1).min(power.len());
            let around = (from..to).filter(|other| other.abs_diff(bin) > LINE_BINS);
            near.extend(around.map(|other| power[other]));
            upper_median(&mut near).unwrap_or(0.0) / median
        })
        .collect()
}
