//! Readout noise of the Pi camera: the part of the variance that does not depend on light.

use super::looks::looks;
use super::map::RadianceMap;
use super::splat::{Key, Optics};
use evrig_core::stats::upper_median;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Pixel step in both axes, and most frames.
const STEP: usize = 9;
const FRAMES: usize = 40;

/// Signal classes, and the fewest pixels of one.
const CLASSES: usize = 16;
const LEAST: usize = 400;

/// Greatest relative change of the map per pixel: above it, registration errors exceed the noise.
const SMOOTH: f64 = 0.02;

/// Median absolute deviation of a standard normal variable, and the efficiency of the median
/// absolute deviation as a scale estimate.
const MEDIAN_AT: f64 = 0.674_49;
const TELLING: f64 = 0.37;

/// Standard deviation of the readout noise in DN, and its standard error; None with too few smooth
/// samples.
///
/// The variance is modelled as a constant, a term proportional to the signal (shot noise) and one
/// proportional to its square (pixel gain spread).
pub(super) fn read_noise(optics: &Optics, map: &RadianceMap, keys: &[Key]) -> Option<[f64; 2]> {
    let chosen: Vec<&Key> = keys.iter().step_by(keys.len().div_ceil(FRAMES).max(1)).collect();
    let of_key = |key: &&Key| smooth(optics, map, key).unwrap_or_default();
    let all: Vec<Vec<Seen>> = chosen.par_iter().map(of_key).collect();
    let mut all: Vec<Seen> = all.into_iter().flatten().collect();
    all.sort_by(|a, b| a.signal.total_cmp(&b.signal));
    let size = all.len().div_ceil(CLASSES).max(LEAST);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let classes: Vec<[f64; 3]> = all.chunks_exact(size).filter_map(class).collect();
    for [signal, variance, n] in &classes {
        let row = Vector3::new(1.0, signal / 100.0, (signal / 100.0).powi(2));
        let precision = TELLING * n / (2.0 * variance * variance);
        normal += precision * row * row.transpose();
        right += precision * *variance * row;
    }
    let inverse = normal.try_inverse().filter(|_| classes.len() > 3)?;
    let fit = inverse * right;
    let misfit = |[signal, variance, n]: &[f64; 3]| {
        let at = signal / 100.0;
        let left = variance - fit[0] - at * (fit[1] + at * fit[2]);
        left * left * TELLING * n / (2.0 * variance * variance)
    };
    let freedom = (classes.len() - 3) as f64;
    let scale = (classes.iter().map(misfit).sum::<f64>() / freedom).max(1.0);
    let noise = fit[0].max(1.0 / 12.0).sqrt();
    Some([noise, 0.5 * (scale * inverse[(0, 0)]).sqrt() / noise])
}

#[derive(Debug, Clone, Copy)]
struct Seen {
    /// Expected signal and residual, DN.
    signal: f64,
    beside: f64,
    /// Bayer site.
    site: usize,
}

/// Pixels that view smooth points.
fn smooth(optics: &Optics, map: &RadianceMap, key: &Key) -> Option<Vec<Seen>> {
    let camera = &optics.camera;
    let pixel_mm = key.pose[2].abs() / camera.lens.focal_px;
    let level = key.ln_gain.exp();
    let mut found = Vec::new();
    looks(optics, map, key, STEP, |look| {
        let [value, dx, dy] = look.mapped;
        if dx.hypot(dy) * pixel_mm < SMOOTH * value {
            let expected = level * value;
            let signal = |light| camera.signal(light, look.x, look.y);
            let (signal, beside) = (signal(expected), signal(look.light - expected));
            found.push(Seen { signal, beside, site: look.y % 2 * 2 + look.x % 2 });
        }
    })?;
    Some(found)
}

/// Median signal, variance and size of a class.
///
/// The median residual of each Bayer site is removed: an error of the black level is not noise.
fn class(pixels: &[Seen]) -> Option<[f64; 3]> {
    let n = pixels.len();
    let beside = |site: usize| -> Vec<f64> {
        let of_site = pixels.iter().filter(|pixel| pixel.site == site);
        of_site.map(|pixel| pixel.beside).collect()
    };
    let mut sizes: Vec<f64> = (0..4)
        .map(beside)
        .filter_map(|all| Some((upper_median(&mut all.clone())?, all)))
        .flat_map(|(middle, all)| all.into_iter().map(move |beside| (beside - middle).abs()))
        .collect();
    let deviation = upper_median(&mut sizes)? / MEDIAN_AT;
    (deviation > 0.0).then_some([pixels[n / 2].signal, deviation * deviation, n as f64])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pedestal_that_each_place_of_the_mosaic_has_its_own_of_is_no_noise() {
        let pixel = |i: u32| {
            let site = (i % 4) as usize;
            let even = f64::from(i.wrapping_mul(2_654_435_761) >> 16) / 65_536.0 - 0.5;
            Seen { signal: 30.0, beside: [9.0, 0.0, -4.0, 6.0][site] + even, site }
        };
        let pixels: Vec<Seen> = (0..4_000).map(pixel).collect();
        let [signal, variance, n] = class(&pixels).unwrap();
        // Of even values within a half half lie within a quarter.
        let expected = (0.25 / MEDIAN_AT).powi(2);
        assert!((variance / expected - 1.0).abs() < 0.1, "{variance} for {expected}");
        assert_eq!([signal, n], [30.0, 4_000.0]);
    }
}
