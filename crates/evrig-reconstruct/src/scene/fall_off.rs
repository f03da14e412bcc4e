//! Vignetting: one point of the target seen by several pixels.
//!
//! The radiance of a point and the map's error there do not depend on the pixel that sees it. A
//! fixed-effects regression, with a constant for each cell of the target, therefore estimates the
//! fall-off without bias even from a map that was made of vignetted frames.

use super::looks::looks;
use super::map::RadianceMap;
use super::robust::clustered;
use super::splat::{Key, Optics};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Pixel step in both axes.
const STEP: usize = 11;

/// Side of a cell of the target, millimetres.
const PLACE_MM: f64 = 1.2;

/// Departure of real lenses and lamps from the quadratic fall-off, as a share of the light.
const SHAPE: f64 = 0.003;

/// Light of one pixel relative to the light expected from the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Glance {
    pub(super) place_mm: [f64; 2],
    /// Squared distance from the image centre over that of the corners.
    pub(super) off_middle: f64,
    /// Light over the expected light, minus one.
    pub(super) beyond: f64,
    pub(super) weight: f64,
}

/// Weighted sums of one cell.
#[derive(Clone, Copy, Default)]
struct Place {
    weight: f64,
    off: f64,
    beyond: f64,
    square: f64,
    across: f64,
}

impl Place {
    fn add(&mut self, glance: &Glance) {
        let Glance { off_middle: off, beyond, weight, .. } = *glance;
        self.weight += weight;
        self.off += weight * off;
        self.beyond += weight * beyond;
        self.square += weight * off * off;
        self.across += weight * off * beyond;
    }

    /// Contribution to the normal equation and its right side with the cell's constant eliminated.
    fn within(&self) -> [f64; 2] {
        let over = 1.0 / self.weight.max(f64::MIN_POSITIVE);
        [self.square - self.off * self.off * over, self.across - self.off * self.beyond * over]
    }
}

/// Corner loss of the Pi's lens beyond the one already corrected, and its standard error.
pub(super) fn more_lost(optics: &Optics, keys: &[Key], map: &RadianceMap) -> Option<[f64; 2]> {
    let of_key = |key: &Key| {
        let level = key.ln_gain.exp();
        let mut glances = Vec::new();
        looks(optics, map, key, STEP, |look| {
            let expected = level * look.mapped[0];
            glances.push(Glance {
                place_mm: look.place_mm,
                off_middle: optics.camera.off_middle(look.x, look.y),
                beyond: look.light / expected - 1.0,
                // Shot noise: the variance of the ratio is inverse to the light.
                weight: expected.max(0.0),
            });
        });
        glances
    };
    let all: Vec<Vec<Glance>> = keys.par_iter().map(of_key).collect();
    corner_loss(all.iter().flatten())
}

/// Corner loss that remains, as a share of the light, and its standard error; None where no cell
/// was seen by different pixels.
pub(super) fn corner_loss<'a>(glances: impl Iterator<Item = &'a Glance>) -> Option<[f64; 2]> {
    let mut places = BTreeMap::<[i64; 2], Place>::new();
    for glance in glances.filter(|glance| glance.beyond.is_finite()) {
        let at = glance.place_mm.map(|mm| (mm / PLACE_MM).floor() as i64);
        places.entry(at).or_default().add(glance);
    }
    let parts: Vec<[f64; 2]> = places.values().map(Place::within).collect();
    let normal: f64 = parts.iter().map(|part| part[0]).sum();
    let all: f64 = places.values().map(|place| place.square).sum();
    // A camera at rest sees every cell with one pixel.
    if normal.is_nan() || normal <= 1e-4 * all {
        return None;
    }
    let slope = parts.iter().map(|part| part[1]).sum::<f64>() / normal;
    let score = |part: &[f64; 2]| SVector::<f64, 1>::new(part[1] - slope * part[0]);
    let scores: Vec<_> = parts.iter().map(score).collect();
    let inverse = SMatrix::<f64, 1, 1>::new(1.0 / normal);
    Some([-slope, clustered(&inverse, &scores)[(0, 0)].max(0.0).sqrt().hypot(SHAPE)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::SplitMix;

    /// Glances of a head that goes to and fro over a print, whose map is wrong from place to place.
    fn glances(loss: f64, way_mm: f64) -> Vec<Glance> {
        let mut random = SplitMix::new(8, 1);
        (0..20_000)
            .map(|i| {
                let middle = way_mm * f64::from(i % 40) / 40.0;
                let x = 60.0 * (random.uniform() - 0.5);
                let place = x + middle;
                let off = (x / 30.0).powi(2);
                let of_place = 0.05 * (place * 0.7).sin();
                let beyond = (1.0 + of_place) * (1.0 - loss * off) - 1.0 + 0.03 * random.normal();
                Glance { place_mm: [place, 0.0], off_middle: off, beyond, weight: 1.0 }
            })
            .collect()
    }

    #[test]
    fn the_loss_is_found_whatever_the_map_is_wrong_by() {
        for loss in [0.0, 0.1, 0.4] {
            let [found, error] = corner_loss(glances(loss, 20.0).iter()).unwrap();
            assert!((found - loss).abs() < 3.0 * error && error < 0.01, "{found} {error}");
        }
    }

    #[test]
    fn a_head_that_stands_tells_nothing() {
        let still = glances(0.3, 0.0);
        let one = still
            .iter()
            .map(|g| Glance { off_middle: (g.place_mm[0].floor() / 30.0).powi(2), ..*g });
        let held: Vec<_> =
            one.map(|g| Glance { place_mm: [g.off_middle * 1e4, 0.0], ..g }).collect();
        assert_eq!(corner_loss(held.iter()), None);
    }
}
