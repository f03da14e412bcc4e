//! A small seeded source of random numbers for resampling and sampling from models.

use std::f64::consts::TAU;

/// The SplitMix64 generator (Steele, Lea and Flood, OOPSLA 2014).
///
/// Each pair of seed and number gives its own sequence, so that work which is spread over
/// threads draws the same numbers in any order.
#[derive(Debug, Clone)]
pub struct SplitMix(u64);

impl SplitMix {
    /// Sequence number `number` of a seed.
    #[must_use]
    pub fn new(seed: u64, number: u64) -> Self {
        let mut mixed = Self(seed ^ 0x5851_F42D_4C95_7F2D);
        let seed = mixed.bits();
        let mut mixed = Self(seed ^ number.wrapping_mul(0xD134_2543_DE82_EF95));
        mixed.bits();
        mixed
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in the open interval (0, 1).
    pub fn uniform(&mut self) -> f64 {
        ((self.bits() >> 12) as f64 + 0.5) * (1.0 / (1_u64 << 52) as f64)
    }

    /// Uniform between two numbers.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform in `0..n`; 0 for `n` of 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.bits()) * n as u128) >> 64) as usize
    }

    /// Exponential of mean one.
    pub fn exponential(&mut self) -> f64 {
        -self.uniform().ln()
    }

    /// Standard normal (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        (2.0 * self.exponential()).sqrt() * (TAU * self.uniform()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::Moments;

    #[test]
    fn draws_have_the_moments_of_their_laws() {
        let mut random = SplitMix::new(7, 3);
        let n = 200_000;
        let uniform: Moments = (0..n).map(|_| random.uniform()).collect();
        let normal: Moments = (0..n).map(|_| random.normal()).collect();
        let waits: Moments = (0..n).map(|_| random.exponential()).collect();
        assert!((uniform.mean() - 0.5).abs() < 0.003);
        assert!((uniform.variance() - 1.0 / 12.0).abs() < 0.001);
        assert!(normal.mean().abs() < 0.01 && (normal.variance() - 1.0).abs() < 0.02);
        assert!((waits.mean() - 1.0).abs() < 0.01 && (waits.variance() - 1.0).abs() < 0.04);
    }

    #[test]
    fn sequences_of_one_seed_are_not_alike() {
        let first = |number| SplitMix::new(5, number).bits();
        let distinct: std::collections::BTreeSet<u64> = (0..10_000).map(first).collect();
        assert_eq!(distinct.len(), 10_000);
    }
}
