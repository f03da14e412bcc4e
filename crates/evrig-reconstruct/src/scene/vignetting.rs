//! Vignetting: one point of the target seen by several pixels.
//!
//! The radiance of a point and the map's error there do not depend on the pixel that sees it. A
//! fixed-effects regression, with a constant for each cell of the target, therefore estimates the
//! fall-off without bias even from a map that was made of vignetted frames.

use super::accumulate::{Keyframe, MapOptics};
use super::clustered_covariance::clustered_covariance;
use super::map::RadianceMap;
use super::map_samples::visit_map_samples;
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Pixel step in both axes.
const PIXEL_STEP: usize = 11;
/// Side of a cell of the target, millimetres.
const CELL_MM: f64 = 1.2;
/// Departure of real lenses and lamps from the quadratic fall-off, as a share of the light.
const MODEL_ERROR: f64 = 0.003;

/// Light of one pixel relative to the light expected from the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapRatio {
    pub(super) place_mm: [f64; 2],
    /// Squared distance from the image centre over that of the corners.
    pub(super) squared_radius: f64,
    /// Light over the expected light, minus one.
    pub(super) excess: f64,
    pub(super) weight: f64,
}

#[derive(Clone, Copy, Default)]
struct CellSums {
    weight: f64,
    off: f64,
    excess: f64,
    square: f64,
    across: f64,
}

impl CellSums {
    fn add(&mut self, ratio: &MapRatio) {
        let MapRatio { squared_radius: off, excess, weight, .. } = *ratio;
        self.weight += weight;
        self.off += weight * off;
        self.excess += weight * excess;
        self.square += weight * off * off;
        self.across += weight * off * excess;
    }

    /// Contribution to the normal equation and its right side with the cell's constant eliminated.
    fn reduced(&self) -> [f64; 2] {
        let over = 1.0 / self.weight.max(f64::MIN_POSITIVE);
        [self.square - self.off * self.off * over, self.across - self.off * self.excess * over]
    }
}

/// Corner loss of the Pi's lens beyond the one already corrected, and its standard error.
pub(super) fn corner_loss_update(
    optics: &MapOptics,
    keys: &[Keyframe],
    map: &RadianceMap,
) -> Option<[f64; 2]> {
    let of_key = |key: &Keyframe| {
        let level = key.ln_gain.exp();
        let mut ratios = Vec::new();
        visit_map_samples(optics, map, key, PIXEL_STEP, |sample| {
            let expected = level * sample.mapped[0];
            ratios.push(MapRatio {
                place_mm: sample.place_mm,
                squared_radius: optics.camera.squared_radius(sample.x, sample.y),
                excess: sample.light / expected - 1.0,
                // Shot noise: the variance of the ratio is inverse to the light.
                weight: expected.max(0.0),
            });
        });
        ratios
    };
    let all: Vec<Vec<MapRatio>> = keys.par_iter().map(of_key).collect();
    corner_loss(all.iter().flatten())
}

/// Corner loss that remains, as a share of the light, and its standard error; None where no cell
/// was seen by different pixels.
pub(super) fn corner_loss<'a>(ratios: impl Iterator<Item = &'a MapRatio>) -> Option<[f64; 2]> {
    let mut cells = BTreeMap::<[i64; 2], CellSums>::new();
    for ratio in ratios.filter(|ratio| ratio.excess.is_finite()) {
        let at = ratio.place_mm.map(|mm| (mm / CELL_MM).floor() as i64);
        cells.entry(at).or_default().add(ratio);
    }
    let parts: Vec<[f64; 2]> = cells.values().map(CellSums::reduced).collect();
    let normal: f64 = parts.iter().map(|part| part[0]).sum();
    let all: f64 = cells.values().map(|place| place.square).sum();
    // A camera at rest sees every cell with one pixel.
    if normal.is_nan() || normal <= 1e-4 * all {
        return None;
    }
    let slope = parts.iter().map(|part| part[1]).sum::<f64>() / normal;
    let score = |part: &[f64; 2]| SVector::<f64, 1>::new(part[1] - slope * part[0]);
    let scores: Vec<_> = parts.iter().map(score).collect();
    let inverse = SMatrix::<f64, 1, 1>::new(1.0 / normal);
    Some([
        -slope,
        clustered_covariance(&inverse, &scores)[(0, 0)].max(0.0).sqrt().hypot(MODEL_ERROR),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::SplitMix;

    /// Ratios of a head that moves over a target whose map has errors in each cell.
    fn ratios(loss: f64, way_mm: f64) -> Vec<MapRatio> {
        let mut random = SplitMix::new(8, 1);
        (0..20_000)
            .map(|i| {
                let middle = way_mm * f64::from(i % 40) / 40.0;
                let x = 60.0 * (random.uniform() - 0.5);
                let place = x + middle;
                let off = (x / 30.0).powi(2);
                let of_place = 0.05 * (place * 0.7).sin();
                let excess = (1.0 + of_place) * (1.0 - loss * off) - 1.0 + 0.03 * random.normal();
                MapRatio { place_mm: [place, 0.0], squared_radius: off, excess, weight: 1.0 }
            })
            .collect()
    }

    #[test]
    fn the_loss_is_found_whatever_the_map_is_wrong_by() {
        for loss in [0.0, 0.1, 0.4] {
            let [found, error] = corner_loss(ratios(loss, 20.0).iter()).unwrap();
            assert!((found - loss).abs() < 3.0 * error && error < 0.01, "{found} {error}");
        }
    }

    #[test]
    fn a_static_head_determines_nothing() {
        let still = ratios(0.3, 0.0);
        let one = still
            .iter()
            .map(|g| MapRatio { squared_radius: (g.place_mm[0].floor() / 30.0).powi(2), ..*g });
        let held: Vec<_> =
            one.map(|g| MapRatio { place_mm: [g.squared_radius * 1e4, 0.0], ..g }).collect();
        assert_eq!(corner_loss(held.iter()), None);
    }
}
