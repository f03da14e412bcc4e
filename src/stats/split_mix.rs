//! Seeded random numbers where a handful of draws is wanted.

/// The SplitMix64 generator (Steele, Lea and Flood, OOPSLA 2014).
#[derive(Debug, Clone)]
pub struct SplitMix(u64);

impl SplitMix {
    /// The sequence number `number` of a seed; sequences of one seed are unrelated.
    #[must_use]
    pub fn new(seed: u64, number: u64) -> Self {
        let mut mixed = Self(seed);
        let offset = mixed.bits();
        Self(offset ^ number.wrapping_mul(0xd134_2543_de82_ef95))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A whole number below `n`; its bias is below n / 2^64.
    pub fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.bits()) * n as u128) >> 64) as usize
    }

    /// Even in 0..1.
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Even between two numbers.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Exponential of mean one.
    pub fn exponential(&mut self) -> f64 {
        -(1.0 - self.uniform()).ln()
    }

    /// Standard normal, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::Moments;

    #[test]
    fn a_sequence_repeats_and_another_differs() {
        let draw = |seed, number| SplitMix::new(seed, number).bits();
        assert_eq!(draw(1, 2), draw(1, 2));
        assert_ne!(draw(1, 2), draw(1, 3));
        assert_ne!(draw(1, 2), draw(2, 2));
    }

    #[test]
    fn uniform_and_normal_have_their_moments() {
        let mut random = SplitMix::new(5, 0);
        let uniform: Moments = (0..40_000).map(|_| random.uniform()).collect();
        let normal: Moments = (0..40_000).map(|_| random.normal()).collect();
        let waits: Moments = (0..40_000).map(|_| random.exponential()).collect();
        assert!((waits.mean() - 1.0).abs() < 5.0 * waits.standard_error());
        assert!((waits.variance() - 1.0).abs() < 0.08);
        assert!((uniform.mean() - 0.5).abs() < 5.0 * uniform.standard_error());
        assert!((uniform.variance() * 12.0 - 1.0).abs() < 0.03);
        assert!(normal.mean().abs() < 5.0 * normal.standard_error());
        assert!((normal.variance() - 1.0).abs() < 0.04);
    }
}
