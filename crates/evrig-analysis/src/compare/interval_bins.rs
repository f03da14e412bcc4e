//! Logarithmic bins of inter-event intervals, the same for every stream and measure.
//!
//! Fine bins: 100 per decade, from 1 µs to 1000 s. Coarse bins: 10 per decade, each of ten fine
//! ones. Intervals of 0 µs go into the first bin, those above 1000 s into the last one.

use std::sync::LazyLock;

/// Decades covered, from 1 µs.
const N_DECADES: usize = 9;
/// Fine bins per decade.
pub(super) const FINE_PER_DECADE: usize = 100;
/// Fine bins in all.
pub(super) const N_FINE: usize = N_DECADES * FINE_PER_DECADE;
/// Fine bins in a coarse one.
pub(super) const FINE_PER_COARSE: usize = 10;
/// Coarse bins in all.
pub(super) const N_COARSE: usize = N_FINE / FINE_PER_COARSE;
/// Intervals below this, µs, are looked up in a table.
const N_SHORT: usize = 1 << 15;

/// First whole microsecond of each fine bin.
static FIRST: LazyLock<Vec<i64>> =
    LazyLock::new(|| (0..N_FINE).map(|bin| (edge(bin) * (1.0 - 1e-12)).ceil() as i64).collect());

static SHORT: LazyLock<Vec<u16>> =
    LazyLock::new(|| (0..N_SHORT as i64).map(|interval| search(interval) as u16).collect());

/// Lower edge of a fine bin, µs.
pub(super) fn edge(bin: usize) -> f64 {
    10_f64.powf(bin as f64 / FINE_PER_DECADE as f64)
}

/// Decadic logarithm of the middle of a fine bin.
pub(super) fn log_middle(bin: usize) -> f64 {
    (bin as f64 + 0.5) / FINE_PER_DECADE as f64
}

/// Assigns intervals to bins.
#[derive(Clone, Copy)]
pub(super) struct Binner {
    first: &'static [i64],
    short: &'static [u16],
}

impl Binner {
    pub(super) fn new() -> Self {
        Self { first: &FIRST, short: &SHORT }
    }

    /// The fine bin of an interval of whole microseconds, not negative.
    pub(super) fn bin(self, interval_us: i64) -> usize {
        if let Some(&bin) = usize::try_from(interval_us).ok().and_then(|i| self.short.get(i)) {
            return bin as usize;
        }
        // The logarithm may be off by one at an edge; the table of edges decides.
        let guess = ((interval_us as f64).log10() * FINE_PER_DECADE as f64) as usize;
        let guess = guess.min(N_FINE - 1);
        if interval_us < self.first[guess] {
            guess - 1
        } else if guess + 1 < N_FINE && interval_us >= self.first[guess + 1] {
            guess + 1
        } else {
            guess
        }
    }
}

/// The last bin that begins at or below the interval; below 10 µs some bins contain no integer.
fn search(interval_us: i64) -> usize {
    FIRST.partition_point(|&first| first <= interval_us).saturating_sub(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_of_ten_opens_its_bin() {
        let binner = Binner::new();
        for decade in 1..9_u32 {
            let interval = 10_i64.pow(decade);
            assert_eq!(binner.bin(interval), decade as usize * 100, "{interval} us");
            assert_eq!(binner.bin(interval - 1) / 100, decade as usize - 1);
        }
    }

    #[test]
    fn every_bin_holds_what_lies_between_its_edges() {
        let binner = Binner::new();
        for interval in (1..200_000_i64).chain((200_000..90_000_000).step_by(9_973)) {
            let bin = binner.bin(interval);
            let value = interval as f64;
            assert!(edge(bin) <= value * (1.0 + 1e-9), "{interval} us in bin {bin}");
            assert!(value < edge(bin + 1) * (1.0 + 1e-9), "{interval} us in bin {bin}");
        }
    }

    #[test]
    fn what_lies_beyond_the_bins_goes_into_the_first_and_last() {
        let binner = Binner::new();
        assert_eq!(binner.bin(0), 0);
        assert_eq!(binner.bin(1), 0);
        assert_eq!(binner.bin(i64::MAX), N_FINE - 1);
    }
}
