//! Random numbers of the world: each run of draws begins at a point that seed, purpose and two
//! numbers (a pixel and a slab, a frame and a row) determine, so that neither threads nor the
//! caller's pace change what is drawn.

use std::sync::LazyLock;

/// What draws are for; two purposes share nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub(super) enum RandomPurpose {
    TargetImage = 1,
    Thresholds,
    HotPixels,
    DeadPixels,
    Phase,
    ShotNoise,
    Spontaneous,
    ApsCoupling,
    Drop,
    Jitter,
    ApsNoise,
    PiNoise,
    PiInterface,
    HostLink,
    ImuZero,
    ImuNoise,
}

/// A run of draws: SplitMix64 (Steele, Lea and Flood, OOPSLA 2014) from a keyed beginning.
#[derive(Debug, Clone)]
pub(super) struct WorldRandom {
    state: u64,
}

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl WorldRandom {
    /// The run for one purpose and two numbers.
    pub(super) fn new(seed: u64, purpose: RandomPurpose, first: u64, second: u64) -> Self {
        let key = mix(seed.wrapping_add(GOLDEN).wrapping_add((purpose as u64).rotate_left(48)));
        let key = mix(key ^ first.wrapping_mul(GOLDEN).wrapping_add(1));
        Self { state: mix(key ^ second.wrapping_mul(0xD1B5_4A32_D192_ED03).wrapping_add(2)) }
    }

    pub(super) fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Uniform in [0, 1).
    pub(super) fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Exponential with mean one.
    pub(super) fn exponential(&mut self) -> f64 {
        -(1.0 - self.uniform()).ln()
    }

    /// Standard normal, through the inverse of its distribution.
    pub(super) fn normal(&mut self) -> f32 {
        normal_from(self.bits())
    }
}

const CELLS: usize = 1 << 12;

/// Quantiles of the normal distribution at the edges of [`CELLS`] cells of equal probability.
static QUANTILES: LazyLock<Vec<f32>> =
    LazyLock::new(|| (0..=CELLS).map(|i| quantile(i as f64 / CELLS as f64) as f32).collect());

/// A standard normal number from 64 random bits: a straight line within the table's cells, the
/// quantile function itself in the outermost ones.
pub(super) fn normal_from(bits: u64) -> f32 {
    let cell = (bits >> 52) as usize;
    if !(8..CELLS - 8).contains(&cell) {
        return quantile(((bits >> 11) as f64 + 0.5) / (1_u64 << 53) as f64) as f32;
    }
    let part = ((bits >> 28) & 0xFF_FFFF) as f32 * (1.0 / 16_777_216.0);
    let table = &*QUANTILES;
    table[cell] + part * (table[cell + 1] - table[cell])
}

/// Quantile of the standard normal distribution.
fn quantile(p: f64) -> f64 {
    let inside = p.clamp(1e-300, 1.0 - 1e-16);
    -std::f64::consts::SQRT_2 * statrs::function::erf::erfc_inv(2.0 * inside)
}

/// The mean of a Poisson number to a draw of it; exact below 64, rounded normal above.
pub(super) fn poisson(draws: &mut WorldRandom, mean: f64) -> u64 {
    if mean > 64.0 {
        return (mean + mean.sqrt() * f64::from(draws.normal())).round().max(0.0) as u64;
    }
    let (mut n, mut left) = (0, mean);
    loop {
        left -= draws.exponential();
        if left < 0.0 {
            return n;
        }
        n += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_the_moments_and_tails_of_a_normal_distribution() {
        let n = 200_000;
        let mut draws = WorldRandom::new(7, RandomPurpose::PiNoise, 3, 4);
        let values: Vec<f64> = (0..n).map(|_| f64::from(draws.normal())).collect();
        let moment = |k: i32| values.iter().map(|v| v.powi(k)).sum::<f64>() / f64::from(n);
        assert!(moment(1).abs() < 0.01, "{}", moment(1));
        assert!((moment(2) - 1.0).abs() < 0.015, "{}", moment(2));
        assert!((moment(4) - 3.0).abs() < 0.1, "{}", moment(4));
        let beyond = values.iter().filter(|v| v.abs() > 3.0).count() as f64 / f64::from(n);
        assert!((beyond - 0.0027).abs() < 0.0006, "{beyond}");
    }

    #[test]
    fn runs_of_different_keys_share_nothing() {
        let first = |seed, a, b| WorldRandom::new(seed, RandomPurpose::Drop, a, b).bits();
        let keys = [first(1, 2, 3), first(1, 3, 2), first(2, 2, 3), first(1, 2, 4)];
        for (i, a) in keys.iter().enumerate() {
            assert!(keys[i + 1..].iter().all(|b| a != b));
        }
        assert_eq!(first(1, 2, 3), keys[0]);
    }

    #[test]
    fn poisson_numbers_have_the_mean_asked_for() {
        let mut draws = WorldRandom::new(1, RandomPurpose::Spontaneous, 0, 0);
        for mean in [0.3, 5.0, 200.0] {
            let n = 4_000;
            let sum: u64 = (0..n).map(|_| poisson(&mut draws, mean)).sum();
            let error = (sum as f64 / f64::from(n) - mean).abs();
            assert!(error < 4.0 * (mean / f64::from(n)).sqrt(), "{mean}: {error}");
        }
    }
}
