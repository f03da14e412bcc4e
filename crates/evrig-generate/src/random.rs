//! Random numbers by counter: each draw is a function of seed, pixel, interval and
//! its number within them, so the order in which pixels are visited changes nothing.
//!
//! The bits are Philox2x64-10 (Salmon et al., "Parallel random numbers: as easy as
//! 1, 2, 3", SC 2011): the key is the seed, the counter is pixel, interval and block
//! of draws. It is a bijection of the counter, so two pixels or intervals never share bits.

mod ziggurat;

use ziggurat::{RandomWords, Ziggurat};

const MULTIPLIER: u64 = 0xD2B7_4407_B1CE_6E93;
const KEY_STEP: u64 = 0x9E37_79B9_7F4A_7C15;
const ROUNDS: usize = 10;

/// One block of Philox2x64-10: 128 bits that depend on every bit of counter and key.
fn philox(mut counter: [u64; 2], mut key: u64) -> [u64; 2] {
    for _ in 0..ROUNDS {
        let product = u128::from(counter[0]) * u128::from(MULTIPLIER);
        counter = [(product >> 64) as u64 ^ key ^ counter[1], product as u64];
        key = key.wrapping_add(KEY_STEP);
    }
    counter
}

/// In place of an interval: what is fixed for a pixel for good, such as its threshold.
pub(super) const PERMANENT: u64 = u64::MAX;

/// The source of all draws of one generator: the seed and the tables.
#[derive(Debug, Clone, Copy)]
pub(super) struct RandomSource {
    seed: u64,
    ziggurat: &'static Ziggurat,
}

/// The draws of one pixel in one interval.
#[derive(Debug, Clone)]
pub(super) struct CounterRng {
    source: RandomSource,
    interval: u64,
    pixel: u32,
    /// Number of the next block.
    block: u32,
    /// The current block, and how many of its words are left.
    words: [u64; 2],
    n_left: u8,
}

impl RandomSource {
    /// All draws of one seed.
    pub(super) fn new(seed: u64) -> Self {
        Self { seed, ziggurat: Ziggurat::tables() }
    }

    /// The draws of pixel number `pixel` (row-major) in one interval, or [`PERMANENT`]. The first
    /// two words are made at once.
    #[inline]
    pub(super) fn draws(self, pixel: u32, interval: u64) -> CounterRng {
        let mut draws = self.draws_from(pixel, interval, 0);
        draws.refill();
        draws
    }

    /// The same from a later block on. Nothing is made before the first draw.
    #[inline]
    pub(super) fn draws_from(self, pixel: u32, interval: u64, block: u32) -> CounterRng {
        CounterRng { source: self, interval, pixel, block, words: [0; 2], n_left: 0 }
    }
}

impl CounterRng {
    /// 64 random bits.
    #[inline]
    pub(super) fn bits(&mut self) -> u64 {
        if self.n_left == 0 {
            self.refill();
        }
        self.n_left -= 1;
        let [first, second] = self.words;
        if self.n_left == 1 { first } else { second }
    }

    #[inline]
    fn refill(&mut self) {
        let place = u64::from(self.pixel) << 32 | u64::from(self.block);
        self.words = philox([place, self.interval], self.source.seed);
        self.block = self.block.wrapping_add(1);
        self.n_left = 2;
    }

    /// Uniform in the open interval (0, 1): the middles of 2^52 equal cells.
    #[inline]
    pub(super) fn uniform(&mut self) -> f64 {
        ((self.bits() >> 12) as f64 + 0.5) * (1.0 / (1_u64 << 52) as f64)
    }

    /// Standard normal.
    #[inline]
    pub(super) fn normal(&mut self) -> f64 {
        let ziggurat = self.source.ziggurat;
        ziggurat.normal(self)
    }
}

impl RandomWords for CounterRng {
    #[inline]
    fn bits(&mut self) -> u64 {
        Self::bits(self)
    }

    #[inline]
    fn uniform(&mut self) -> f64 {
        Self::uniform(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ks;
    use statrs::distribution::{ContinuousCDF, Normal};

    #[test]
    fn philox_gives_the_authors_known_answers() {
        // Random123, tests/kat_vectors, lines "philox2x64 10".
        assert_eq!(philox([0; 2], 0), [0xca00_a045_9843_d731, 0x66c2_4222_c9a8_45b5]);
        assert_eq!(philox([u64::MAX; 2], u64::MAX), [0x65b0_21d6_0cd8_310f, 0x4d02_f322_2f86_df20]);
        assert_eq!(
            philox([0x243f_6a88_85a3_08d3, 0x1319_8a2e_0370_7344], 0xa409_3822_299f_31d0),
            [0x0a5e_742c_2997_341c, 0xb0f8_83d3_8000_de5d]
        );
    }

    #[test]
    fn uniform_draws_are_uniform_over_pixels_intervals_and_draws() {
        let source = RandomSource::new(1);
        let sample = |pixel, interval, skip| {
            let mut draws = source.draws(pixel, interval);
            for _ in 0..skip {
                let _ = draws.bits();
            }
            draws.uniform()
        };
        ks::assert_law((0..100_000).map(|i| sample(i, 7, 0)), |u| u);
        ks::assert_law((0..100_000).map(|i| sample(3, i, 1)), |u| u);
        ks::assert_law((0..1_000).map(|i| sample(3, 5, i)), |u| u);
    }

    #[test]
    fn normal_draws_follow_the_normal_law_far_into_the_tail() {
        let law = Normal::standard();
        let mut draws = RandomSource::new(2).draws(0, PERMANENT);
        let sample: Vec<f64> = (0..400_000).map(|_| draws.normal()).collect();
        ks::assert_law(sample.iter().copied(), |z| law.cdf(z));
        // Beyond the outermost layer (3.654) the tail has its own sampler: its law is checked
        // given that it was entered.
        let mut draws = RandomSource::new(3).draws(0, PERMANENT);
        let edge = 3.0;
        let tail = (0..2_000_000).map(|_| draws.normal().abs()).filter(|&z| z > edge);
        let outside = 1.0 - law.cdf(edge);
        ks::assert_law(tail, |z| 1.0 - (1.0 - law.cdf(z)) / outside);
    }
}
