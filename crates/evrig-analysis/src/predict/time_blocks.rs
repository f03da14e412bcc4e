//! Equal blocks of a time window.

/// A time window divided into equal blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeBlocks {
    length_us: i64,
    n: usize,
}

impl TimeBlocks {
    /// `n` blocks, at least one, of a window of `length_us`.
    #[must_use]
    pub fn new(length_us: i64, n: usize) -> Self {
        let n = n.clamp(1, length_us.max(1) as usize);
        Self { length_us: length_us.max(1), n }
    }

    /// Number of blocks.
    #[must_use]
    pub const fn n(&self) -> usize {
        self.n
    }

    /// Length of the window, microseconds.
    #[must_use]
    pub const fn length_us(&self) -> i64 {
        self.length_us
    }

    /// The block of a time since the window's start; the nearest one outside the window.
    #[must_use]
    pub fn of(&self, t_us: f64) -> usize {
        let position = t_us / self.length_us as f64 * self.n as f64;
        (position.max(0.0) as usize).min(self.n - 1)
    }

    /// The end of a block, microseconds since the window's start.
    #[must_use]
    pub fn end_us(&self, block: usize) -> f64 {
        (block + 1) as f64 * self.length_us as f64 / self.n as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_instant_lies_in_the_block_that_ends_next() {
        let blocks = TimeBlocks::new(1_000, 3);
        for t in 0..1_000 {
            let t = f64::from(t);
            let block = blocks.of(t);
            assert!(t <= blocks.end_us(block) + 1e-9);
            assert!(block == 0 || t >= blocks.end_us(block - 1) - 1e-9);
        }
        assert_eq!((blocks.of(-5.0), blocks.of(1e9)), (0, 2));
    }
}
