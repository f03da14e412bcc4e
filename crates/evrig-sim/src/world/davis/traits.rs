//! What is fixed for each pixel for good: thresholds, leaks, and whether it works at all.

use super::comparator::Comparator;
use super::pixel::PixelTraits;
use crate::world::description::WorldDescription;
use crate::world::draws::{RandomPurpose, WorldRandom};
use crate::world::effects::WorldEffects;
use evrig_core::geometry::Size;

/// A threshold is never less than this share of the nominal one.
const LOWEST_THRESHOLD: f64 = 0.2;

/// The traits of all pixels, row-major.
pub(super) fn all(description: &WorldDescription, size: Size, seed: u64) -> Vec<PixelTraits> {
    let effects = &description.effects;
    let none = WorldEffects::default();
    let width = usize::from(size.width);
    let mut traits: Vec<PixelTraits> = (0..size.n_pixels())
        .map(|pixel| {
            let (x, y) = ((pixel % width) as u16, (pixel / width) as u16);
            let is_affected = effects.region.is_none_or(|region| region.contains(x, y));
            let effects = if is_affected { effects } else { &none };
            let own = of_pixel(pixel, effects, description.davis.threshold, seed);
            PixelTraits { is_affected, ..own }
        })
        .collect();
    let n_dead = effects.dead_pixels.map_or(0, |dead| dead.count as usize);
    let mut candidates: Vec<usize> =
        (0..traits.len()).filter(|pixel| traits[*pixel].is_affected).collect();
    let mut draws = WorldRandom::new(seed, RandomPurpose::DeadPixels, 0, 0);
    for _ in 0..n_dead.min(candidates.len()) {
        let chosen = (draws.uniform() * candidates.len() as f64) as usize;
        traits[candidates.swap_remove(chosen)].is_dead = true;
    }
    traits
}

fn of_pixel(pixel: usize, effects: &WorldEffects, threshold: f64, seed: u64) -> PixelTraits {
    let ratio = effects.threshold_asymmetry.map_or(1.0, |asymmetry| asymmetry.on_off_ratio);
    let (mut on, mut off) = (threshold * ratio.sqrt(), threshold / ratio.sqrt());
    if let Some(mismatch) = effects.threshold_mismatch {
        let mut draws = WorldRandom::new(seed, RandomPurpose::Thresholds, pixel as u64, 0);
        let [a, b] = [draws.normal(), draws.normal()].map(f64::from);
        let share = mismatch.correlation;
        let other = share * a + (1.0 - share * share).max(0.0).sqrt() * b;
        on *= (1.0 + mismatch.sigma_relative * a).max(LOWEST_THRESHOLD);
        off *= (1.0 + mismatch.sigma_relative * other).max(LOWEST_THRESHOLD);
    }
    let mut leak_hz = effects.junction_leak.map_or(0.0, |leak| leak.rate_hz);
    if let Some(hot) = effects.hot_pixels {
        let mut draws = WorldRandom::new(seed, RandomPurpose::HotPixels, pixel as u64, 0);
        if draws.uniform() < hot.fraction {
            let [slow, fast] = hot.rate_hz;
            leak_hz += slow * (fast / slow).max(1.0).powf(draws.uniform());
        }
    }
    // A leak drifts towards ON at so many of the nominal thresholds a second.
    let nominal = threshold * ratio.sqrt();
    let at_white = effects.photocurrent_leak.map_or(0.0, |leak| leak.rate_hz_at_white);
    let growth = effects.temperature_drift.map_or(0.0, |drift| drift.rate_hz_per_s);
    PixelTraits {
        comparator: Comparator {
            on,
            off,
            refractory: effects.refractory_period.map_or(0.0, |dead| dead.refractory_us * 1e-6),
            fatigue: effects.threshold_fatigue.map(|tired| (tired.rise, tired.recovery_s)),
        },
        leak: [leak_hz, at_white, growth].map(|rate| rate * nominal),
        is_dead: false,
        is_affected: true,
        latency: effects.pixel_latency.map_or(0.0, |latency| latency.latency_us * 1e-6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effects::{DeadPixels, HotPixels, ThresholdMismatch};
    use evrig_core::geometry::Rectangle;

    fn world(effects: WorldEffects) -> WorldDescription {
        WorldDescription { effects, ..WorldDescription::default() }
    }

    #[test]
    fn thresholds_scatter_as_asked_and_on_goes_with_off() {
        let mismatch = ThresholdMismatch { sigma_relative: 0.1, correlation: 0.5 };
        let effects =
            WorldEffects { threshold_mismatch: Some(mismatch), ..WorldEffects::default() };
        let all = all(&world(effects), Size::new(200, 100), 3);
        let relative: Vec<[f64; 2]> = all
            .iter()
            .map(|traits| [traits.comparator.on, traits.comparator.off].map(|t| t / 0.19 - 1.0))
            .collect();
        let mean = |f: &dyn Fn(&[f64; 2]) -> f64| {
            relative.iter().map(f).sum::<f64>() / relative.len() as f64
        };
        assert!((mean(&|r| r[0] * r[0]).sqrt() - 0.1).abs() < 0.003);
        assert!((mean(&|r| r[1] * r[1]).sqrt() - 0.1).abs() < 0.003);
        assert!((mean(&|r| r[0] * r[1]) / 0.01 - 0.5).abs() < 0.03);
    }

    #[test]
    fn dead_pixels_are_counted_and_hot_ones_are_a_share_within_the_region() {
        let region = Rectangle { x_px: [0, 50], y_px: [0, 100] };
        let effects = WorldEffects {
            dead_pixels: Some(DeadPixels { count: 17 }),
            hot_pixels: Some(HotPixels { fraction: 0.02, rate_hz: [10.0, 300.0] }),
            region: Some(region),
            ..WorldEffects::default()
        };
        let all = all(&world(effects), Size::new(200, 100), 3);
        let in_region = |i: usize| i % 200 < 50;
        assert_eq!(all.iter().filter(|traits| traits.is_dead).count(), 17);
        assert!(all.iter().enumerate().all(|(i, traits)| !traits.is_dead || in_region(i)));
        let n_hot = all.iter().filter(|traits| traits.leak[0] > 0.0).count();
        assert!((n_hot as f64 - 100.0).abs() < 35.0, "{n_hot}");
    }
}
