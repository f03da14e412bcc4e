//! Dead pixels: some pixels never fire.
//!
//! Signature: no event where neighbours fire in every segment.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, stream_of};
use crate::pixel_model::PixelModel;
use evrig_core::effect_id::EffectId;

effect! {
    /// Pixels that never fire, drawn from the whole sensor.
    DeadPixels, Emission, "no event from the pixels of a fixed set" {
        /// How many, a whole number.
        count: 0.0 to 1e6,
    }
}

impl EffectModel for DeadPixels {
    fn apply_to_pixel(&self, site: &PixelSite<'_>, pixel: &mut PixelModel) {
        let n_pixels = site.size.n_pixels() as u32;
        let place = shuffled(site.number(), n_pixels, |half, round| {
            site.source.draws(half, stream_of(EffectId::DeadPixels) ^ (round << 32)).bits()
        });
        pixel.is_dead |= f64::from(place) + 0.5 < self.count;
    }
}

/// The place of `number` in a shuffle of `0..n`: a Feistel network of four rounds over the next
/// power of four, walked until it comes back below `n`; `mix` gives its round function.
fn shuffled(number: u32, n: u32, mix: impl Fn(u32, u64) -> u64) -> u32 {
    let half_bits = (32 - n.saturating_sub(1).leading_zeros()).div_ceil(2).max(1);
    let mask = (1_u32 << half_bits) - 1;
    let mut place = number;
    loop {
        let (mut left, mut right) = (place >> half_bits, place & mask);
        for round in 0..4 {
            (left, right) = (right, left ^ (mix(right, round) as u32 & mask));
        }
        place = left << half_bits | right;
        if place < n {
            return place;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::shuffled;
    use crate::effect::test_support::*;

    #[test]
    fn as_many_pixels_as_stated_are_silent() {
        let all = events(&passing(2.0, -1.0), 1.0, &["dead_pixels:count=7"]);
        assert_eq!(counts(&all).iter().filter(|&&n| n == 0.0).count(), 7);
    }

    #[test]
    fn a_shuffle_leaves_no_number_out() {
        for n in [1, 2, 3, 17, 64, 1000] {
            let mut places: Vec<u32> = (0..n)
                .map(|i| shuffled(i, n, |half, round| u64::from(half * 7 + 3) ^ (round * 5)))
                .collect();
            places.sort_unstable();
            assert!(places.into_iter().eq(0..n));
        }
    }
}
